"""`eigenfail campaign region`: where among a scenario's parameters a planner fails."""

from collections.abc import Iterator
from typing import Annotated

import typer
from rich.console import Group, RenderableType
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from eigenfail.cli.figures import UNKNOWN, rate
from eigenfail.cli.options import DEFAULT_URL, AsJson, Url
from eigenfail.cli.output import show
from eigenfail.cli.surroundings import client_at
from eigenfail.cli.tables import table
from eigenfail.values import Rate, Region

Ids = Annotated[
    list[int],
    typer.Argument(
        metavar="CAMPAIGN...", min=1, help="One whose scenario varies, or those of a grid."
    ),
]

FIGURES = ("share of all failures [95 %]", "failure rate inside [95 %]", "failed", "episodes")


def region(
    context: typer.Context, campaigns: Ids, url: Url = DEFAULT_URL, as_json: AsJson = False
) -> None:
    """Show where among the scenario's parameters the episodes of campaigns fail."""
    with client_at(context, url) as client:
        found = client.campaigns.region(campaigns)
    show(found, as_json, lambda: Group(*parts(found)))


def parts(found: Region) -> Iterator[RenderableType]:
    """The parts of the page."""
    ids = ", ".join(map(str, found.campaigns))
    yield Text(f"Failing region of {found.scenario}, campaigns {ids}: {summary(found)}")
    if found.boxes:
        yield box_table(found)
        yield Text(
            f"Found on half of the episodes, counted on the others: {rate(found.failure_rate)} of "
            f"these fail. By chance alone: p = {found.p_value:.1g}."
        )
    remarks = (found.problem, *(f"Warning: {each}" for each in found.warnings))
    yield from (Text(remark) for remark in remarks if remark)


def summary(found: Region) -> str:
    """What it rests on."""
    varied = ", ".join(found.parameters) or "nothing"
    return f"{found.failures} of {found.episodes} episodes failed; {varied} varied"


def box_table(found: Region) -> Table:
    """One box a row, and all of them together."""
    grid = table("where", *FIGURES, right=FIGURES)
    rows = [(box.words, box.coverage, box.precision) for box in found.boxes]
    if len(rows) > 1:
        rows.append(("all of these", found.coverage or rows[0][1], found.precision))
    for words, coverage, precision in rows:
        grid.add_row(escape(words), rate(coverage), rate(precision), *counted(precision))
    return grid


def counted(value: Rate | None) -> tuple[str, str]:
    """Failures and episodes inside."""
    return (UNKNOWN, UNKNOWN) if value is None else (str(value.k), str(value.n))
