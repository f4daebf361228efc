"""`eigenfail compare`: two campaigns, or several seeds of each, side by side."""

import re
from collections.abc import Iterator
from typing import Annotated

import typer
from rich.console import Group, RenderableType
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from eigenfail.cli.figures import cost_per_failure, number, rate
from eigenfail.cli.options import DEFAULT_URL, AsJson, Url
from eigenfail.cli.output import show
from eigenfail.cli.surroundings import client_at
from eigenfail.cli.tables import table
from eigenfail.errors import InvalidValue
from eigenfail.values import Comparison, Side

app = typer.Typer(add_completion=False)

IDS = re.compile(r"[1-9]\d*(,[1-9]\d*)*")

SideIds = Annotated[
    str, typer.Argument(help="Id of a campaign, or of several seeds of it, such as 1,2,3.")
]


@app.command()
def compare(
    context: typer.Context,
    a: SideIds,
    b: SideIds,
    url: Url = DEFAULT_URL,
    as_json: AsJson = False,
) -> None:
    """Compare two campaigns, or several seeds of each.

    Failure rates and their difference with 95 % intervals, cost per failure and log p per step;
    where both saw the same noise (Monte Carlo or replay from the same seed) McNemar's exact test
    on pairs of episodes; over two or more seeds the Vargha-Delaney effect size.
    """
    sides = campaign_ids("A", a), campaign_ids("B", b)
    with client_at(context, url) as client:
        found = client.campaigns.compare(*sides)
    show(found, as_json, lambda: comparison_page(found))


def campaign_ids(side: str, text: str) -> tuple[int, ...]:
    """The ids of one side.

    Raises:
        InvalidValue: they are not numbers with commas in between.
    """
    if not IDS.fullmatch(text):
        raise InvalidValue(side, f"'{text}' is not of the form 1 or 1,2,3.", "Give campaign ids.")
    return tuple(map(int, text.split(",")))


def comparison_page(found: Comparison) -> Group:
    """The figures, what they say, and what speaks against it."""
    return Group(*parts(found))


def parts(found: Comparison) -> Iterator[RenderableType]:
    """The parts of the page."""
    yield side_table(found)
    yield from (Text(sentence) for sentence in found.sentences)
    if found.distinctions:
        yield Text()
        yield distinction_table(found)
    yield from (Text(f"Warning: {warning}", style="bold") for warning in found.warnings)


def side_table(found: Comparison) -> Table:
    """Both sides, one a row; severity in m²/s²."""
    figures = ("episodes", "failures", "failure rate [95 %]", "log p/step", "severity")
    costs = ("USD/failure [95 %]",)
    grid = table("", "campaigns", *figures, *costs, right=(*figures, *costs))
    for name, side in (("A", found.a), ("B", found.b)):
        grid.add_row(name, *(escape(cell) for cell in side_row(side)))
    return grid


def side_row(side: Side) -> tuple[str, ...]:
    """The figures of one side."""
    return (
        ",".join(map(str, side.campaigns)),
        str(side.completed),
        str(side.failures),
        rate(side.failure_rate),
        number(side.log_probability_per_step),
        number(side.mean_severity, 1),
        cost_per_failure(side.cost),
    )


def distinction_table(found: Comparison) -> Table:
    """In what the sides differ."""
    grid = table("differs in", "A", "B")
    for each in found.distinctions:
        grid.add_row(escape(each.thing), escape(each.a), escape(each.b))
    return grid
