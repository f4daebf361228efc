"""The fingerprint of planners' code: other where the code, what it needs or its settings are."""

import sys
from types import SimpleNamespace

import pytest
from msgspec.structs import replace

from eigenfail.cli import gate
from eigenfail.cli.gate import fingerprint
from eigenfail.errors import InvalidValue, UnknownName
from eigenfail.suites import Suite, SuiteMember
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.versions import list_packages, read_package_files

SPEC = CampaignSpec(name="x", method="monte_carlo", episodes=1, planner="idm")


def suite_of(**fields):
    return Suite("s", (SuiteMember("a", replace(SPEC, **fields)),))


@pytest.fixture
def package(tmp_path, monkeypatch):
    """A folder with a module and a package, where Python finds them."""
    monkeypatch.syspath_prepend(tmp_path)
    (tmp_path / "lone_planner.py").write_text("x = 1\n")
    (tmp_path / "whole_planner" / "__pycache__").mkdir(parents=True)
    (tmp_path / "whole_planner" / "__init__.py").write_text("")
    (tmp_path / "whole_planner" / "weights.bin").write_bytes(b"\x00")
    (tmp_path / "whole_planner" / "__pycache__" / "a.pyc").write_bytes(b"1")
    return tmp_path


def test_the_same_code_has_the_same_fingerprint():
    assert fingerprint(suite_of()) == fingerprint(suite_of())
    assert len(fingerprint(suite_of())) == 12


def test_other_settings_or_planners_have_another():
    found = {
        fingerprint(suite_of()),
        fingerprint(suite_of(planner="rulebook")),
        fingerprint(suite_of(planner_settings={"time_headway_s": 2.0})),
    }
    assert len(found) == 3
    assert fingerprint(suite_of(seed=5)) == fingerprint(suite_of())


def test_changed_code_has_another(package):
    of_function = suite_of(simulator="function", scenario="function", planner="lone_planner:x")
    before = fingerprint(of_function)
    (package / "lone_planner.py").write_text("x = 2\n")
    assert fingerprint(of_function) != before


def test_another_release_of_anything_installed_has_another(monkeypatch):
    before = fingerprint(suite_of())
    other = SimpleNamespace(metadata={"Name": "osqp"}, version="99")
    monkeypatch.setattr(gate, "distributions", lambda: [other])
    assert fingerprint(suite_of()) != before


def test_all_files_of_a_package_count_but_compiled_ones(package):
    assert dict(read_package_files("whole_planner")) == {"__init__.py": b"", "weights.bin": b"\x00"}
    assert dict(read_package_files("lone_planner")) == {"": b"x = 1\n"}


def test_planner_scenario_and_simulator_are_looked_at():
    assert set(list_packages(SPEC)) == {"eigenfail_workers"}
    assert "eigenfail_misbehaving" in set(list_packages(replace(SPEC, planner="test_raises")))


def test_what_is_not_installed_here_is_refused():
    with pytest.raises(UnknownName, match="Did you mean 'rulebook'"):
        fingerprint(suite_of(planner="rulebok"))
    assert "no_such_module" not in sys.modules
    with pytest.raises(InvalidValue, match="Give --planner-version"):
        list(read_package_files("no_such_module"))
