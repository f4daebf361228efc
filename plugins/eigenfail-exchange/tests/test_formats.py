"""Formats: what can be written here, and what is refused."""

import importlib.util
from pathlib import Path

import numpy as np
import pytest
from made_recordings import drive, record
from msgspec.structs import replace

from eigenfail import exchange
from eigenfail.client.episodes import choose_recording_format
from eigenfail.errors import InvalidValue, UnknownName
from eigenfail.exchange import list_formats, write_recording
from eigenfail.exchange.recording import EgoControl, RecordingFormat, find_presence

MAGIC = {
    RecordingFormat.OPENSCENARIO: b"PK\x03\x04",
    RecordingFormat.MCAP: b"\x89MCAP0\r\n",
    RecordingFormat.GIF: b"GIF89a",
}


@pytest.fixture
def without(monkeypatch):
    """Hides a module from those that look for it."""

    def hide(name):
        find = importlib.util.find_spec
        monkeypatch.setattr(
            exchange, "find_spec", lambda each: None if each == name else find(each)
        )

    return hide


@pytest.mark.parametrize("form", RecordingFormat)
def test_a_file_is_of_its_format(form):
    assert write_recording(record(), form).startswith(MAGIC[form])


@pytest.mark.parametrize(("name", "form"), [("PIL", "gif"), ("mcap", "mcap")])
def test_a_format_without_its_package_is_refused_with_what_to_install(without, name, form):
    without(name)
    assert form not in list_formats()
    assert RecordingFormat.OPENSCENARIO in list_formats()
    with pytest.raises(InvalidValue, match=r"pip install '\.\[exchange\]'"):
        write_recording(record(), RecordingFormat(form))


@pytest.mark.parametrize("form", ["gif", "mcap"])
def test_only_openscenario_leaves_the_ego_to_a_controller(form):
    with pytest.raises(InvalidValue, match="openscenario"):
        write_recording(record(), RecordingFormat(form), EgoControl.CONTROLLER)


def test_an_episode_with_too_many_poses_is_refused(monkeypatch):
    monkeypatch.setattr(exchange, "MAX_POSES", 38)
    with pytest.raises(InvalidValue, match="39 poses"):
        write_recording(record(), RecordingFormat.GIF)


@pytest.mark.parametrize(
    ("name", "form", "chosen"),
    [
        ("a.zip", None, "openscenario"),
        ("a.ZIP", "openscenario", "openscenario"),
        ("a.mcap", None, "mcap"),
        ("a.gif", None, "gif"),
        ("a.bin", "mcap", "mcap"),
    ],
)
def test_the_name_of_a_file_chooses_its_format(name, form, chosen):
    assert choose_recording_format(Path(name), form) == chosen


@pytest.mark.parametrize(
    ("name", "form", "error", "words"),
    [
        ("a.xosc", None, InvalidValue, "a.zip"),
        ("a.xml", "openscenario", InvalidValue, "a.zip"),
        ("a.mp4", None, UnknownName, "gif"),
        ("a.csv", "csv", UnknownName, "mcap"),
    ],
)
def test_a_name_or_format_that_cannot_be_is_refused(name, form, error, words):
    with pytest.raises(error, match=words):
        choose_recording_format(Path(name), form)


def test_presence_is_the_spans_of_finite_poses():
    assert find_presence(drive(), 0) == [(0, 12)]
    assert find_presence(drive(), 2) == [(2, 4), (7, 11)]
    gone = drive()
    gone.vehicles[:, 2] = np.nan
    assert find_presence(gone, 2) == []
    assert write_recording(replace(record(), scene=gone), RecordingFormat.OPENSCENARIO)
