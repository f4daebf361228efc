"""Charts of several campaigns: their courses and costs, drawn over one another."""

from bisect import bisect_right
from collections.abc import Iterator, Sequence

import msgspec
import numpy as np

from eigenfail.presentation import figures
from eigenfail.presentation.rates import name_rates
from eigenfail.values import Campaign, CampaignCost, CostPoint, Course
from eigenfail.values.records import EpisodeRow
from eigenfail.worlds import world_of
from eigenfail_api.dashboard.charts import (
    MOST_ROWS,
    Chart,
    format_bounds,
    format_span,
    round_values,
)

STEPS = 10
"""Rows of the table."""


ROUNDING = 1e-9


SIDES = ("A", "B")


FINDS = {"failures": "Failures", "modes": "Distinct modes"}


class Line(msgspec.Struct, frozen=True):
    """A campaign of a side."""

    side: int
    cost: CampaignCost

    @property
    def name(self) -> str:
        """As a column is headed."""
        return f"{SIDES[self.side]}: {self.cost.campaign} {self.cost.method}"


def make_bill_charts(*sides: Sequence[CampaignCost]) -> tuple[Chart, ...]:
    """Return the charts of failures, and of modes if any are known, over the money spent."""
    lines = [Line(side, cost) for side, costs in enumerate(sides) for cost in costs]
    known = {find: [line for line in lines if has_curve(line, find)] for find in FINDS}
    return tuple(make_bill_chart(find, some) for find, some in known.items() if some)


def has_curve(line: Line, find: str) -> bool:
    """Return whether a campaign has found anything that a curve can show."""
    curve = line.cost.curve
    return len(curve) > 1 and getattr(curve[-1], find) is not None


def make_bill_chart(find: str, lines: Sequence[Line]) -> Chart:
    """Return the chart of one kind of finding over the money spent."""
    title = f"{FINDS[find]} against cost"
    return Chart(
        id=f"bill-{find}-chart",
        kind="bills",
        title=title,
        caption=f"{FINDS[find]} found by accumulated cost, one line per campaign.",
        data={
            "what": FINDS[find],
            "lines": [
                {
                    "name": line.name,
                    "side": line.side,
                    "usd": round_values(point.usd for point in line.cost.curve),
                    "found": [getattr(point, find) for point in line.cost.curve],
                }
                for line in lines
            ],
        },
        columns=("USD", *(line.name for line in lines)),
        rows=tuple(iterate_bill_rows(find, lines)),
        note="–: no further cost.",
    )


def iterate_bill_rows(find: str, lines: Sequence[Line]) -> Iterator[tuple[str, ...]]:
    """Yield the findings of each campaign at equal steps of money."""
    most = max(line.cost.cost.total_usd for line in lines)
    for step in range(1, STEPS + 1):
        usd = most * step / STEPS
        yield (figures.format_number(usd), *(count_found(find, line.cost, usd) for line in lines))


def count_found(find: str, cost: CampaignCost, usd: float) -> str:
    """Return the number that a campaign had found at a cost; a dash once nothing more was spent."""
    if usd > cost.cost.total_usd * (1.0 + ROUNDING):
        return figures.UNKNOWN
    spent = [point.usd for point in cost.curve]
    point: CostPoint = cost.curve[max(bisect_right(spent, usd * (1.0 + ROUNDING)) - 1, 0)]
    return figures.format_count(getattr(point, find))


MOST_POINTS = 600
"""Failures that are drawn of each campaign."""


SHARES = np.linspace(0.0, 1.0, 101)


QUANTILES = (0.0, 0.1, 0.25, 0.5, 0.75, 0.9, 1.0)


class Compared(msgspec.Struct, frozen=True, kw_only=True):
    """The figures of one campaign in a comparison.

    Attributes:
        rows: a sample of its episodes.
    """

    campaign: Campaign
    course: Course
    cost: CampaignCost
    rows: Sequence[EpisodeRow]

    @property
    def name(self) -> str:
        """As a legend names it."""
        return f"{self.campaign.id}: {self.campaign.spec.name}"


def make_overlays(compared: Sequence[Compared]) -> tuple[Chart, ...]:
    """Return the charts for which there are data."""
    charts = (
        make_rate_chart(compared),
        make_cost_chart(compared),
        make_severity_chart(compared),
        make_distance_chart(compared),
    )
    return tuple(chart for chart in charts if chart.rows)


def make_rate_chart(compared: Sequence[Compared]) -> Chart:
    """Return the chart of the failure rate, or share of failures, over episodes."""
    what = name_rates(block.failure_rate for one in compared for block in one.course.blocks)
    lines = [
        make_line(
            one,
            [(block.first + block.last) / 2.0 for block in one.course.blocks],
            list_percents(one),
        )
        for one in compared
    ]
    rows = [
        (
            one.name,
            format_span(block),
            figures.format_share(block.failure_rate.value),
            format_bounds(block.failure_rate),
        )
        for one in compared
        for block in one.course.blocks
    ]
    return Chart(
        id="overlay-rate",
        kind="overlay",
        title=f"{what} over episodes",
        caption="By blocks of episodes; the table holds the 95 % intervals of random samples."
        + _explain_searches(compared),
        data=draw_lines("Episode", f"{what} [%]", lines),
        columns=("Campaign", "Episodes", what, "95 % interval"),
        rows=tuple(rows[:MOST_ROWS]),
        note=describe_left_out(len(rows)),
    )


def _explain_searches(compared: Sequence[Compared]) -> str:
    """Return what the lines of searches show; empty where every campaign is a random sample."""
    rates = [(one, block.failure_rate) for one in compared for block in one.course.blocks]
    searches = dict.fromkeys(str(one.campaign.id) for one, rate in rates if not rate.sampled)
    if not searches:
        return ""
    return (
        f" The line of a search (campaign {', '.join(searches)}) is the share of failures among "
        "the episodes that it chose, and no failure rate under p(x)."
    )


def list_percents(one: Compared) -> list[float]:
    """Return the failure rates by block [%]."""
    return [100.0 * block.failure_rate.share for block in one.course.blocks]


def make_cost_chart(compared: Sequence[Compared]) -> Chart:
    """Return the chart of failures over the money spent."""
    known = [one for one in compared if len(one.cost.curve) > 1]
    lines = [
        make_line(
            one,
            [point.usd for point in one.cost.curve],
            [float(point.failures) for point in one.cost.curve],
        )
        for one in known
    ]
    return Chart(
        id="overlay-cost",
        kind="overlay",
        title="Failures against cost",
        caption="Failures found by accumulated cost.",
        data={**draw_lines("USD", "Failures", lines), "look": "steps"},
        columns=("USD", *(one.name for one in known)),
        rows=tuple(iterate_cost_rows(known)),
        note="–: no further cost.",
    )


def iterate_cost_rows(known: Sequence[Compared]) -> Iterator[tuple[str, ...]]:
    """Yield the failures of each campaign at equal steps of money."""
    most = max((one.cost.cost.total_usd for one in known), default=0.0)
    for step in range(1, STEPS + 1) if most else ():
        usd = most * step / STEPS
        yield (
            figures.format_number(usd),
            *(count_found("failures", one.cost, usd) for one in known),
        )


def make_severity_chart(compared: Sequence[Compared]) -> Chart:
    """Return the chart of the failures' likelihood and severity."""
    points = [(one, list_failures(one)) for one in compared]
    lines = [
        make_line(
            one,
            [row.log_probability / max(row.steps, 1) for row in found],
            [row.severity or 0.0 for row in found],
        )
        for one, found in points
    ]
    return Chart(
        id="overlay-severity",
        kind="overlay",
        title="Likelihood and severity of the failures",
        caption=(
            f"Each mark is a failure, at most {MOST_POINTS} of each campaign; farther to the right "
            "is likelier, farther up is worse."
        ),
        data={**draw_lines("log p per step", "Severity [m²/s²]", lines), "look": "marks"},
        columns=("Campaign", "Failures drawn", "Median log p per step", "Median severity [m²/s²]"),
        rows=tuple(make_severity_row(one, found) for one, found in points if found),
    )


def list_failures(one: Compared) -> list[EpisodeRow]:
    """Return failures of the sample, thinned evenly."""
    found = [row for row in one.rows if row.outcome.is_failure and row.severity]
    return found[:: -(-len(found) // MOST_POINTS) or 1]


def make_severity_row(one: Compared, found: Sequence[EpisodeRow]) -> tuple[str, ...]:
    """Return the medians of a campaign's failures."""
    likely = float(np.median([row.log_probability / max(row.steps, 1) for row in found]))
    severe = float(np.median([row.severity or 0.0 for row in found]))
    return (
        one.name,
        figures.format_count(len(found)),
        figures.format_number(likely),
        figures.format_number(severe),
    )


def make_distance_chart(compared: Sequence[Compared]) -> Chart:
    """Return the chart of the distribution of robustness; that of a function has no unit."""
    roads = [world_of(one.campaign.spec.simulator).has_road for one in compared]
    unit = " [m]" if all(roads) else " [m on the road]" if any(roads) else ""
    nothing = "0 m" if all(roads) else "0"
    known = [(one, measured) for one in compared if (measured := list_robustness(one))]
    lines = [
        make_line(one, np.quantile(found, SHARES).tolist(), (100.0 * SHARES).tolist())
        for one, found in known
    ]
    return Chart(
        id="overlay-robustness",
        kind="overlay",
        title="Distribution of robustness",
        caption=f"Cumulative share of episodes by robustness; {nothing} is a failure.",
        data=draw_lines(f"Robustness{unit}", "Episodes [%]", lines),
        columns=("Campaign", "Episodes", *(f"{100 * share:.0f} %" for share in QUANTILES)),
        rows=tuple(
            (
                one.name,
                figures.format_count(len(found)),
                *(figures.format_number(float(each)) for each in np.quantile(found, QUANTILES)),
            )
            for one, found in known
        ),
        note=f"Quantiles of robustness{unit}.",
    )


def list_robustness(one: Compared) -> list[float]:
    """Return the robustness of the episodes of the sample, where it was measured [m]."""
    return [row.robustness_m for row in one.rows if row.robustness_m is not None]


def make_line(one: Compared, x: Sequence[float], y: Sequence[float]) -> dict[str, object]:
    """Return a campaign's line of a chart."""
    return {"name": one.name, "id": one.campaign.id, "x": round_values(x), "y": round_values(y)}


def draw_lines(x: str, y: str, lines: list[dict[str, object]]) -> dict[str, object]:
    """What the browser draws."""
    return {"x": x, "y": y, "look": "lines", "lines": lines}


def describe_left_out(rows: int) -> str:
    """Return the note that a table ends early."""
    return f"The first {MOST_ROWS} of {rows} rows." if rows > MOST_ROWS else ""
