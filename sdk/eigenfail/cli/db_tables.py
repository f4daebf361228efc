"""What came of a database's check, for people."""

from collections.abc import Iterator

from rich.console import Group
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from eigenfail.cli.tables import table
from eigenfail.values.upkeep import Check, Verification


def verification(found: Verification) -> Group:
    """What was mended, what was asked, and what is wrong."""
    return Group(*map(Text, found.mended), check_table(found.checks), *map(Text, defects(found)))


def check_table(checks: tuple[Check, ...]) -> Table:
    """One row a check."""
    grid = table("", "check", "what holds", "defects", right={"defects"})
    for check in checks:
        mark = "wrong" if check.defects else "ok"
        cells = (mark, check.name, check.promise, str(check.defects or "-"))
        grid.add_row(*map(escape, cells))
    return grid


def defects(found: Verification) -> Iterator[str]:
    """One line for each that is shown, and how many there are besides."""
    for check in found.checks:
        for defect in check.shown:
            yield f"{check.name}: {defect.where}: {defect.found} {defect.remedy}"
        if more := check.defects - len(check.shown):
            yield f"{check.name}: and {more} more."
