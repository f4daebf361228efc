"""Formats: what their files begin with, and what is refused."""

import sys

import numpy as np
import pytest
from made_recordings import drive, record
from msgspec.structs import replace

from eigenfail import plugins
from eigenfail.contracts.recording import KNOWN, EgoControl, find_format, list_formats
from eigenfail.errors import InvalidValue
from eigenfail_exchange.road import find_presence

MAGIC = {"openscenario": b"PK\x03\x04", "mcap": b"\x89MCAP0\r\n", "gif": b"GIF89a"}


@pytest.fixture
def without(monkeypatch):
    """Hides a module from those that import it, and has formats loaded anew."""

    def hide(name):
        for loaded in ("animation", "mcap_log"):
            monkeypatch.delitem(sys.modules, f"eigenfail_exchange.{loaded}", raising=False)
        for each in [name, *(each for each in sys.modules if each.startswith(f"{name}."))]:
            monkeypatch.setitem(sys.modules, each, None)
        plugins.load.cache_clear()

    yield hide
    plugins.load.cache_clear()


def test_the_formats_are_those_that_errors_of_the_core_name():
    assert [name for name in list_formats() if name in KNOWN] == [*KNOWN] == [*MAGIC]


@pytest.mark.parametrize("form", MAGIC)
def test_a_file_is_of_its_format(form):
    content = find_format(form).write(record(), EgoControl.RECORDED)
    assert content.startswith(MAGIC[form])


@pytest.mark.parametrize(("name", "form"), [("PIL", "gif"), ("mcap", "mcap")])
def test_a_format_without_its_package_is_refused_with_what_is_missing(without, name, form):
    without(name)
    assert form not in list_formats()
    assert "openscenario" in list_formats()
    with pytest.raises(InvalidValue, match=rf"'{form}' cannot be loaded: .*{name}"):
        find_format(form)


def test_presence_is_the_spans_of_finite_poses():
    assert find_presence(drive(), 0) == [(0, 12)]
    assert find_presence(drive(), 2) == [(2, 4), (7, 11)]
    gone = drive()
    gone.vehicles[:, 2] = np.nan
    assert find_presence(gone, 2) == []
    write = find_format("openscenario").write
    assert write(replace(record(), scene=gone), EgoControl.RECORDED)
