"""A plug-in held against its contract, with a sentence on everything that breaks it."""

import sys
from collections.abc import Iterator
from enum import StrEnum
from pathlib import Path
from threading import Thread
from typing import Any

import msgspec
from rich.markup import escape
from rich.table import Table

from eigenfail import plugins
from eigenfail.cli.contracts import PLANNER, SCENARIO, Check, Contract
from eigenfail.cli.tables import table
from eigenfail.errors import EigenfailError, InvalidValue

PATIENCE_S = 60.0
"""No check is waited for longer; a planner that just keeps its time needs half of it."""
ENDLESS = "It did not come to an end within {:g} s."
SKIPPED = "Not checked: put the one above right first."


class Verdict(StrEnum):
    """What came of a check."""

    PASSED = "passed"
    BROKEN = "broken"
    SLOW = "slow"
    SKIPPED = "skipped"


class Checked(msgspec.Struct, frozen=True):
    """One check of one plug-in, and in words what holds or what breaks the contract."""

    plugin: str
    check: str
    verdict: Verdict
    said: str


def check_up(planner: str | None, scenario: str | None) -> list[Checked]:
    """Every check of the plug-ins given, by name or as module:Class.

    Raises:
        UnknownName: nothing of that name is registered.
        InvalidValue: it cannot be loaded.
    """
    asked = [(PLANNER, planner), (SCENARIO, scenario)]
    loaded = [(kind, place, load(kind.group, place)) for kind, place in asked if place]
    return [checked for found in loaded for checked in examined(*found)]


def load(group: str, place: str) -> Any:
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
    except Exception as error:
        problem = f"'{place}' cannot be loaded: {type(error).__name__}: {error}."
        raise InvalidValue("plug-in", problem) from error
    finally:
        sys.path.pop(0)


def examined(contract: Contract, place: str, plugin: Any) -> Iterator[Checked]:
    """One check after the other; none after one that is vital, or that does not end."""
    checks = contract.checks(plugin)
    for check in checks:
        broken = what_breaks(check)
        verdict = Verdict.BROKEN if broken else Verdict.PASSED
        yield Checked(place, check.name, verdict, broken or check.promise)
        if broken and (check.vital or broken == ENDLESS.format(PATIENCE_S)):
            break
    for check in checks:
        yield Checked(place, check.name, Verdict.SKIPPED, SKIPPED)


def what_breaks(check: Check) -> str:
    """What the check found, in words; nothing if the contract is kept."""
    complaint = Complaint()
    # A plug-in may never return: its thread must not keep the command from ending.
    thread = Thread(target=complaint.about, args=(check,), daemon=True)
    thread.start()
    thread.join(PATIENCE_S)
    return ENDLESS.format(PATIENCE_S) if thread.is_alive() else complaint.said


class Complaint:
    """What a check found; whatever a stranger's plug-in raises is part of it."""

    said = ""

    def about(self, check: Check) -> None:
        """Run the check."""
        with self:
            check.run()

    def __enter__(self) -> None:
        """Nothing found yet."""

    def __exit__(self, kind: type[BaseException] | None, error: object, trace: object) -> bool:
        """Keep the error as a sentence."""
        if kind is not None:
            raised = f"It raised {kind.__name__}: {error}."
            self.said = str(error) if issubclass(kind, AssertionError) else raised
        return True


def check_table(checks: list[Checked]) -> Table:
    """One row a check."""
    grid = table("", "plug-in", "check", "what holds, or what breaks it")
    for check in checks:
        cells = (check.verdict, check.plugin, check.check, check.said)
        grid.add_row(*(escape(cell) for cell in cells))
    return grid
