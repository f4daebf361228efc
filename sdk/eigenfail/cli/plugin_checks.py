"""Checks of a plug-in against its contract, each with a sentence on what breaks it."""

import sys
from collections.abc import Callable, Iterator
from enum import StrEnum
from functools import partial
from pathlib import Path
from threading import Thread
from typing import Any

import msgspec
from rich.markup import escape
from rich.table import Table

from eigenfail import plugins
from eigenfail.errors import EigenfailError, InvalidValue, describe_error, read_text
from eigenfail.presentation.terminal import start_grid
from eigenfail.settings import read_settings
from eigenfail.testing import expect
from eigenfail.testing.planner import PLANNER_CHECKS
from eigenfail.testing.scenario import SCENARIO_CHECKS


class PluginCheck(msgspec.Struct, frozen=True):
    """One question to a plug-in; `run` raises if the answer is wrong.

    Attributes:
        promise: what holds if it passes.
        vital: whether no other question makes sense if it fails.
    """

    name: str
    promise: str
    run: Callable[[], None]
    vital: bool = False


class Contract(msgspec.Struct, frozen=True):
    """The requirements for plug-ins of one kind.

    Attributes:
        group: where they are registered.
        settings: the class attribute with their settings or parameters.
        suite: the conformance suite.
        subject: maker of the argument of each check, from the plug-in.
    """

    group: str
    settings: str
    suite: tuple[Callable[[Any], None], ...]
    subject: Callable[[Any], Any]

    def checks(self, plugin: Any) -> Iterator[PluginCheck]:
        """Every question to one plug-in."""
        about = f"Its `{self.settings}` is a msgspec.Struct whose fields have defaults."
        yield PluginCheck(
            f"has {self.settings}", about, partial(_require_defaults, self, plugin), vital=True
        )
        for check in self.suite:
            promise = (check.__doc__ or "").partition("\n")[0]
            run = partial(self._ask, check, plugin)
            yield PluginCheck(check.__name__.replace("_", " "), promise, run)

    def _ask(self, check: Callable[[Any], None], plugin: Any) -> None:
        check(self.subject(plugin))


def _require_defaults(contract: Contract, plugin: Any) -> None:
    """The plug-in's settings are readable, and complete without a user's."""
    kind = getattr(plugin, contract.settings, None)
    is_struct = isinstance(kind, type) and issubclass(kind, msgspec.Struct)
    expect(is_struct, f"It has no class attribute `{contract.settings}` that is a msgspec.Struct.")
    read_settings(getattr(plugin, contract.settings), {}, contract.settings)


def _make_planner_factory(plugin: Any) -> Callable[[], Any]:
    """Makes planners with default settings."""
    return lambda: plugin(read_settings(plugin.Settings, {}, "planner_settings"))


def _make_scenario(plugin: Any) -> Any:
    """The scenario itself."""
    return plugin()


PLANNER = Contract(plugins.PLANNERS, "Settings", PLANNER_CHECKS, _make_planner_factory)
SCENARIO = Contract(plugins.SCENARIOS, "Parameters", SCENARIO_CHECKS, _make_scenario)


PATIENCE_S = 60.0
"""No check is waited for longer; a planner that just keeps its time needs half of it."""
ENDLESS = "It did not finish within {:g} s."
SKIPPED = "Not checked: fix the previous error first."


class CheckVerdict(StrEnum):
    """The result of a check."""

    PASSED = "passed"
    BROKEN = "broken"
    SLOW = "slow"
    SKIPPED = "skipped"
    NOTED = "noted"


class CheckResult(msgspec.Struct, frozen=True):
    """One check of one plug-in, and in words what holds or what breaks the contract."""

    plugin: str
    check: str
    verdict: CheckVerdict
    said: str


def check_plugins(planner: str | None, scenario: str | None) -> list[CheckResult]:
    """Every check of the plug-ins given, by name or as module:Class.

    Raises:
        UnknownName: nothing of that name is registered.
        InvalidValue: it cannot be loaded.
    """
    asked = [(PLANNER, planner), (SCENARIO, scenario)]
    loaded = [(kind, place, _load(kind.group, place)) for kind, place in asked if place]
    return [checked for found in loaded for checked in run_checks(*found)]


def _load(group: str, place: str) -> Any:
    """The plug-in registered under a name, or found at module:Class below this folder.

    Raises:
        UnknownName: nothing of that name is registered.
        InvalidValue: it cannot be loaded.
    """
    if ":" not in place:
        return plugins.load(group, place)
    sys.path.insert(0, str(Path.cwd()))
    try:
        return plugins.load_class(place)
    except EigenfailError:
        raise
    except (Exception, SystemExit) as error:
        problem = f"'{place}' cannot be loaded: {describe_error(error)}."
        raise InvalidValue("plug-in", problem) from error
    finally:
        sys.path.pop(0)


def run_checks(contract: Contract, place: str, plugin: Any) -> Iterator[CheckResult]:
    """One check after the other; none after one that is vital, or that does not end."""
    checks = contract.checks(plugin)
    for check in checks:
        broken = _find_complaint(check)
        verdict = CheckVerdict.BROKEN if broken else CheckVerdict.PASSED
        yield CheckResult(place, check.name, verdict, broken or check.promise)
        if broken and (check.vital or broken == ENDLESS.format(PATIENCE_S)):
            break
    for check in checks:
        yield CheckResult(place, check.name, CheckVerdict.SKIPPED, SKIPPED)
    for sentence in _list_notes(contract, plugin):
        yield CheckResult(place, "uses its recording", CheckVerdict.NOTED, sentence)


def _list_notes(contract: Contract, plugin: Any) -> list[str]:
    """What a scenario does not use of its recording, which breaks no contract."""
    notes: list[str] = []
    if contract is SCENARIO:
        # What breaks here has broken a check before.
        with Complaint():
            notes += map(str, getattr(contract.subject(plugin), "notes", ()))
    return notes


def _find_complaint(check: PluginCheck) -> str:
    """What the check found, in words; nothing if the contract is kept."""
    complaint = Complaint()
    # A plug-in may never return: its thread must not keep the command from ending.
    thread = Thread(target=complaint.about, args=(check,), daemon=True)
    thread.start()
    thread.join(PATIENCE_S)
    return ENDLESS.format(PATIENCE_S) if thread.is_alive() else complaint.said


class Complaint:
    """A finding of a check; any exception of the plug-in becomes part of it."""

    said = ""

    def about(self, check: PluginCheck) -> None:
        """Run the check."""
        with self:
            check.run()

    def __enter__(self) -> None:
        """Nothing found yet."""

    def __exit__(
        self, _kind: type[BaseException] | None, error: BaseException | None, trace: object
    ) -> bool:
        """Keep the error as a sentence."""
        if error is not None:
            raised = f"It raised {describe_error(error)}."
            self.said = read_text(error) if isinstance(error, AssertionError) else raised
        return True


def tabulate_checks(checks: list[CheckResult]) -> Table:
    """One row a check."""
    grid = start_grid("", "plug-in", "check", "result or violation")
    for check in checks:
        cells = (check.verdict, check.plugin, check.check, check.said)
        grid.add_row(*(escape(cell) for cell in cells))
    return grid
