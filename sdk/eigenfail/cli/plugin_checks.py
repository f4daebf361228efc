"""Checks of a plug-in against its contract, each with a sentence on what breaks it."""

import sys
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import suppress
from enum import StrEnum
from functools import partial
from pathlib import Path
from threading import Thread
from typing import Any, NamedTuple

import msgspec

from eigenfail import plugins
from eigenfail.errors import EigenfailError, InvalidValue, describe_error, read_text
from eigenfail.presentation import tables
from eigenfail.settings import read_settings
from eigenfail.testing import expect
from eigenfail.testing.learner import LearnerSuite
from eigenfail.testing.planner import PLANNER_CHECKS
from eigenfail.testing.scenario import SCENARIO_CHECKS


class PluginCheck(NamedTuple):
    """One question to a plug-in; `ask` raises unless `promise` holds."""

    name: str
    promise: str
    ask: Callable[[], object]


class Contract(NamedTuple):
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

    def list_checks(self, plugin: Any) -> Iterator[PluginCheck]:
        """Yield every question to one plug-in; without the first, no other makes sense."""
        about = f"Its `{self.settings}` is a msgspec.Struct whose fields have defaults."
        yield PluginCheck(f"has {self.settings}", about, partial(_require_defaults, self, plugin))
        for check in self.suite:
            # The subject is made where the check runs: what its maker raises is a complaint, too.
            def ask(check: Callable[[Any], None] = check) -> None:
                check(self.subject(plugin))

            promise = (check.__doc__ or "").partition("\n")[0]
            yield PluginCheck(check.__name__.removeprefix("test_").replace("_", " "), promise, ask)


def _require_defaults(contract: Contract, plugin: Any) -> None:
    """The plug-in's settings are readable, and complete without a user's."""
    kind = getattr(plugin, contract.settings, None)
    is_struct = isinstance(kind, type) and issubclass(kind, msgspec.Struct)
    expect(is_struct, f"It has no class attribute `{contract.settings}` that is a msgspec.Struct.")
    read_settings(getattr(plugin, contract.settings), {}, contract.settings)


def _make_planner_factory(plugin: Any) -> Callable[[], Any]:
    """Makes planners with default settings."""
    return lambda: plugin(read_settings(plugin.Settings, {}, "planner_settings"))


def _make_method_suite(plugin: Any) -> Any:
    """Makes the conformance suite of a method; its rounds have 100 episodes at most."""
    return type("MethodSuite", (LearnerSuite,), {"method": plugin, "budget": 400, "most": 100})()


METHOD_CHECKS = tuple(ask for name, ask in vars(LearnerSuite).items() if name.startswith("test_"))
SCENARIO = Contract(plugins.SCENARIOS, "Parameters", SCENARIO_CHECKS, lambda plugin: plugin())
CONTRACTS = {
    "planner": Contract(plugins.PLANNERS, "Settings", PLANNER_CHECKS, _make_planner_factory),
    "scenario": SCENARIO,
    "method": Contract(plugins.METHODS, "Settings", METHOD_CHECKS, _make_method_suite),
}
"""The contract of each kind of plug-in, by the option that checks one."""


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


def check_plugins(asked: Mapping[str, str | None]) -> list[CheckResult]:
    """Every check of the plug-ins given, each by its kind: a name, or module:Class.

    Raises:
        UnknownName: nothing of that name is registered.
        InvalidValue: it cannot be loaded.
    """
    pairs = [(CONTRACTS[kind], place) for kind, place in asked.items() if place]
    loaded = [(contract, place, _load(contract.group, place)) for contract, place in pairs]
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
    """One check after the other; none after the first if it fails, or after one without an end."""
    checks = contract.list_checks(plugin)
    for number, check in enumerate(checks):
        broken = _find_complaint(check)
        verdict = CheckVerdict.BROKEN if broken else CheckVerdict.PASSED
        yield CheckResult(place, check.name, verdict, broken or check.promise)
        # What did not end is still running: it would disturb the checks behind it.
        if broken and (not number or broken == ENDLESS.format(PATIENCE_S)):
            break
    for check in checks:
        yield CheckResult(place, check.name, CheckVerdict.SKIPPED, SKIPPED)
    if contract is SCENARIO:
        # What a scenario does not use of its recording breaks no contract. What breaks here has
        # broken a check before.
        with suppress(Exception, SystemExit):
            for sentence in getattr(contract.subject(plugin), "notes", ()):
                yield CheckResult(place, "uses its recording", CheckVerdict.NOTED, str(sentence))


def _find_complaint(check: PluginCheck) -> str:
    """The findings of the check, in words; nothing if the contract is kept."""
    complaints: list[str] = []

    def ask() -> None:
        try:
            check.ask()
        except AssertionError as error:
            complaints.append(read_text(error))
        except BaseException as error:  # noqa: BLE001 - whatever a plug-in raises is a finding
            complaints.append(f"It raised {describe_error(error)}.")

    # A plug-in may never return: its thread must not keep the command from ending.
    thread = Thread(target=ask, daemon=True)
    thread.start()
    thread.join(PATIENCE_S)
    return ENDLESS.format(PATIENCE_S) if thread.is_alive() else "".join(complaints)


def tabulate_checks(checks: Iterable[CheckResult]) -> tables.Table:
    """One row a check."""
    return tables.tabulate(
        "Checks",
        checks,
        tables.read_text("", "verdict"),
        tables.read_text("Plug-in", "plugin"),
        tables.read_text("Check", "check"),
        tables.read_text("Result or violation", "said"),
    )
