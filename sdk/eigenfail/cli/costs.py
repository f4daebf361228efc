"""`eigenfail campaign cost`: what failures and modes cost, method beside method."""

from bisect import bisect_right
from collections.abc import Iterator, Sequence
from typing import Annotated

import typer
from rich.console import Group, RenderableType
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from eigenfail.cli.figures import UNKNOWN, cost_per_failure, count, number, usd
from eigenfail.cli.options import DEFAULT_URL, AsJson, Url
from eigenfail.cli.output import show
from eigenfail.cli.surroundings import client_at
from eigenfail.cli.tables import table
from eigenfail.values import CampaignCost, CostPoint, TimeSplit

Ids = Annotated[
    list[int], typer.Argument(metavar="CAMPAIGN...", min=1, help="One campaign, or several.")
]

STEPS = 10
PARTS = ("simulation_s", "learning_s", "waiting_s", "lost_s")
BILL = ("episodes", "failures", "USD", "USD/failure [95 %]", "modes", "USD/mode")
TIME = ("active", "simulation", "learning", "waiting", "lost")


def cost(
    context: typer.Context, campaigns: Ids, url: Url = DEFAULT_URL, as_json: AsJson = False
) -> None:
    """Show what failures and modes cost, by when, and what the time went into, side by side.

    A campaign without a failure shows the least that one can cost (95 %): the bound that Monte
    Carlo has to be held against.
    """
    with client_at(context, url) as client:
        found = [client.campaigns.cost(campaign) for campaign in campaigns]
    show(found, as_json, lambda: Group(*parts(found)))


def parts(found: Sequence[CampaignCost]) -> Iterator[RenderableType]:
    """The parts of the page."""
    yield bill_table(found)
    yield Text()
    yield time_table(found)
    yield Text()
    yield curve_table(found)
    for each in found:
        yield Text(f"Campaign {each.campaign}: {each.modes_in_words}")
    notes = dict.fromkeys(note for each in found for note in (*each.notes, each.time.problem))
    yield from (Text(note) for note in notes if note)


def bill_table(found: Sequence[CampaignCost]) -> Table:
    """What each campaign cost, and what that bought."""
    grid = table("id", "name", "method", *BILL, right=("id", *BILL))
    for each in found:
        bought = (cost_per_failure(each.cost), count(each.modes), usd(each.per_mode_usd))
        counts = (str(each.completed), str(each.failures), usd(each.cost.total_usd))
        cells = (str(each.campaign), each.name, each.method, *counts, *bought)
        grid.add_row(*map(escape, cells))
    return grid


def time_table(found: Sequence[CampaignCost]) -> Table:
    """What the time went into that each campaign was billed for."""
    grid = table("id", "method", *TIME, right=("id", *TIME))
    for each in found:
        grid.add_row(str(each.campaign), escape(each.method), *shares(each.time))
    return grid


def shares(time: TimeSplit) -> Iterator[str]:
    """The time, and its parts in percent."""
    yield f"{number(time.active_s, 1)} s"
    for name in PARTS:
        part_s = getattr(time, name)
        told = part_s is not None and time.active_s > 0.0
        yield f"{100.0 * part_s / time.active_s:.1f} %" if told else UNKNOWN


def curve_table(found: Sequence[CampaignCost]) -> Table:
    """Failures, and modes where they are known, by the money spent until then."""
    names = [f"{each.campaign} {each.method}" for each in found]
    grid = table("USD", *names, right=("USD", *names))
    most = max(each.cost.total_usd for each in found)
    for step in range(1, STEPS + 1):
        spent = most * step / STEPS
        grid.add_row(usd(spent), *(escape(bought(each, spent)) for each in found))
    return grid


def bought(found: CampaignCost, spent: float) -> str:
    """Failures and modes by an amount; a dash once nothing more was spent."""
    curve = found.curve
    if spent > found.cost.total_usd * (1.0 + 1e-9):
        return UNKNOWN
    point: CostPoint = curve[max(bisect_right([each.usd for each in curve], spent) - 1, 0)]
    modes = "" if point.modes is None else f" ({point.modes} modes)"
    return f"{point.failures} failures{modes}"
