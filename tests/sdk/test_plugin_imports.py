"""Plug-ins whose import does harm, in processes that only read their settings."""

import sys
from importlib.metadata import EntryPoint

import numpy as np
import pytest

from eigenfail import plugins
from eigenfail.errors import InvalidValue, UnknownName
from eigenfail.process_state import ProcessState

CHANGES = """
import numpy as np

np.seterr(all="raise")

class Planner:
    class Settings: ...
"""


@pytest.fixture
def foreign(tmp_path, monkeypatch):
    """Registers a planner 'foreign' in a module of this text; its name."""
    monkeypatch.syspath_prepend(tmp_path)
    monkeypatch.setattr(plugins, "_keeps_import_effects", False)

    def register(text: str) -> str:
        (tmp_path / "harmful_planner.py").write_text(text)
        point = EntryPoint("foreign", "harmful_planner:Planner", plugins.PLANNERS)
        monkeypatch.setattr(plugins, "list_entry_points", lambda group: {"foreign": point})
        return point.name

    yield register
    plugins.load.cache_clear()
    sys.modules.pop("harmful_planner", None)


@pytest.mark.fault("plug-in whose import changes the process")
def test_what_the_import_of_a_plug_in_changes_is_undone_and_logged(foreign, caplog) -> None:
    before = ProcessState()
    assert plugins.load(plugins.PLANNERS, foreign(CHANGES)).__name__ == "Planner"
    assert before.changes() == []
    (line,) = caplog.messages
    assert "The import of the plug-in 'foreign' changed process-wide state" in line
    assert "numpy's error state (np.seterr), which was" in line


def test_a_process_that_runs_its_episodes_keeps_what_the_import_changes(foreign) -> None:
    before = ProcessState()
    try:
        plugins.keep_import_effects()
        plugins.load(plugins.PLANNERS, foreign(CHANGES))
        assert np.geterr()["over"] == "raise"
    finally:
        before.restore()
    assert before.changes() == []


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("raise ValueError('\\udc80')", "ValueError: \\udc80."),
        ("raise SystemExit(3)", "SystemExit: 3."),
        ("import no_such_module", "cannot be loaded: No module named 'no_such_module'."),
        ("x = 1 /", "SyntaxError: "),
        ("", "has no attribute 'Planner'"),
    ],
)
@pytest.mark.fault("plug-in whose import raises")
def test_a_plug_in_that_cannot_be_imported_is_refused_with_the_reason(foreign, text, said) -> None:
    with pytest.raises(InvalidValue, match="'foreign' cannot be loaded") as caught:
        plugins.load(plugins.PLANNERS, foreign(text))
    assert said in str(caught.value)
    with pytest.raises(InvalidValue, match="'harmful_planner:Planner' cannot be loaded") as named:
        plugins.load_class("harmful_planner:Planner")
    assert said in str(named.value)


def test_a_plug_in_without_settings_is_refused_alone(foreign) -> None:
    with pytest.raises(InvalidValue, match="harmful_planner:Planner has no `Settings`") as caught:
        plugins.load(plugins.PLANNERS, foreign("class Planner: ..."))
    assert "Give it a class `Settings` of msgspec.Struct" in str(caught.value)


def test_only_what_eigenfail_brings_is_built_in() -> None:
    assert plugins.is_built_in(plugins.PLANNERS, "rulebook")
    assert plugins.is_built_in(plugins.METHODS, "ast")
    assert not plugins.is_built_in(plugins.PLANNERS, "test_raises")
    assert not plugins.is_built_in(plugins.PLANNERS, "no such planner")


def test_what_is_like_no_name_may_be_newer_than_the_process() -> None:
    with pytest.raises(
        UnknownName, match=r"is not known\. If its package is new, start the service"
    ):
        plugins.load(plugins.PLANNERS, "late_arrival")
    with pytest.raises(UnknownName) as misspelt:
        plugins.load(plugins.PLANNERS, "rulebok")
    assert misspelt.value.problem == "planner: 'rulebok' is not known."
