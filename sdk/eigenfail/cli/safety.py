"""`eigenfail campaign safety`: the safety measures of a campaign's episodes."""

from collections.abc import Iterator
from typing import Annotated

import typer
from rich.console import Group, RenderableType
from rich.markup import escape
from rich.table import Table
from rich.text import Text

from eigenfail.cli.campaign_facts import mean
from eigenfail.cli.figures import UNKNOWN, number, rate
from eigenfail.cli.options import DEFAULT_URL, AsJson, CampaignId, Url
from eigenfail.cli.output import show
from eigenfail.cli.surroundings import client_at
from eigenfail.cli.tables import facts, table
from eigenfail.values import Figure, Rate, Safety, Violations
from eigenfail.values.safety import LEVEL

Level = Annotated[float, typer.Option(help="Of VaR and CVaR of severity.")]

COLUMNS = ("episodes", "share [95 %]", "median", "worst")


def safety(
    context: typer.Context,
    campaign: CampaignId,
    level: Level = LEVEL,
    url: Url = DEFAULT_URL,
    as_json: AsJson = False,
) -> None:
    """Show collisions, near misses, MinTTC, DRAC and severity of a campaign's episodes."""
    with client_at(context, url) as client:
        found = client.campaigns.safety(campaign, level)
    show(found, as_json, lambda: Group(*parts(found)))


def parts(found: Safety) -> Iterator[RenderableType]:
    """The parts of the page."""
    title = f"Safety measures of campaign {found.campaign}, {found.name} ({found.method}): "
    yield Text(f"{title}{found.completed} episodes")
    yield measure_table(found)
    yield Text()
    yield collision_facts(found)
    remarks = (found.severity.problem, *found.notes)
    yield from (Text(remark) for remark in remarks if remark)


def measure_table(found: Safety) -> Table:
    """The paper's table: how many episodes were beyond each threshold, medians and worst cases."""
    grid = table("", *COLUMNS, right=COLUMNS)
    ttc, drac = found.ttc, found.drac
    rows = (
        ("collision", counted(found.collisions), UNKNOWN, UNKNOWN),
        ("near miss", counted(found.near_misses), UNKNOWN, UNKNOWN),
        (f"MinTTC < {ttc.threshold:g} s", counted(ttc.beyond), *extremes(ttc, "s", 3)),
        (f"DRAC > {drac.threshold:g} m/s²", counted(drac.beyond), *extremes(drac, "m/s²", 2)),
    )
    for name, (count, share), middle, worst in rows:
        grid.add_row(*map(escape, (name, count, share, middle, worst)))
    return grid


def counted(value: Rate | None) -> tuple[str, str]:
    """How many, and their share."""
    return (UNKNOWN if value is None else str(value.k)), rate(value)


def extremes(row: Violations, unit: str, digits: int) -> tuple[str, str]:
    """Median and worst case, with their unit."""
    known = [number(value, digits) for value in (row.median, row.worst)]
    middle, worst = (text if text == UNKNOWN else f"{text} {unit}" for text in known)
    return middle, worst


def collision_facts(found: Safety) -> Table:
    """Whose failures the collisions are, how early they showed, how severe they were."""
    classes, risk, scatter = found.conflicts, found.severity, found.scatter
    whose = f"{classes.unavoidable} unavoidable, {classes.planner_failures} planner failures"
    late = f", {classes.unclassified} not classified" if classes.unclassified else ""
    tail = f"{figure(risk.var)} VaR, {figure(risk.cvar)} CVaR at {risk.level:g}"
    return facts(
        [
            ("collisions", f"{whose}{late}"),
            ("mean lead time", f"{mean(classes.ttc_lead)} MinTTC, {mean(classes.drac_lead)} DRAC"),
            ("severity", f"{figure(risk.mean)} mean, {tail} m²/s² (n = {risk.n})"),
            (
                "log p per step against severity",
                f"ρ = {figure(scatter.rank_correlation, 2)} (Spearman, n = {len(scatter.points)})",
            ),
        ]
    )


def figure(value: Figure | None, digits: int = 1) -> str:
    """A number with its 95 % interval, where there is one."""
    if value is None:
        return UNKNOWN
    if value.interval is None:
        return number(value.value, digits)
    low, high = (number(end, digits) for end in (value.interval.low, value.interval.high))
    return f"{number(value.value, digits)} [{low}, {high}]"
