"""Charts of several campaigns: their courses and costs, drawn over one another."""

from collections.abc import Mapping, Sequence

import msgspec
import numpy as np

from eigenfail.presentation import figures
from eigenfail.presentation.campaigns import find_purchase, list_amounts
from eigenfail.presentation.rates import name_rates
from eigenfail.values.campaign import Campaign
from eigenfail.values.records import EpisodeRow
from eigenfail.values.summary import CampaignCost, Course
from eigenfail.worlds import find_robustness_unit
from eigenfail_api.dashboard.charts import (
    MOST_ROWS,
    Chart,
    ChartTable,
    collect_floats,
    format_bounds,
    format_span,
    note_the_first,
)

FINDS = {"failures": "Failures", "modes": "Distinct modes"}


def make_bill_charts(*sides: Sequence[CampaignCost]) -> tuple[Chart, ...]:
    """Return the charts of failures, and of modes if any are known, over the money spent."""
    costs = {
        f"{side}: {cost.campaign} {cost.method}": cost
        for side, bills in zip("AB", sides, strict=False)
        for cost in bills
    }
    charts = (make_bill_chart(f"bill-{find}-chart", find, costs) for find in FINDS)
    return tuple(chart for chart in charts if chart.table.rows)


def make_bill_chart(name: str, find: str, costs: Mapping[str, CampaignCost]) -> Chart:
    """Return the chart of one kind of finding over the money spent.

    Args:
        name: id of the chart.
        find: the kind, a field of the points of a curve.
        costs: costs of campaigns by the name of their line; those without a curve are left out.
    """
    known = {
        title: cost
        for title, cost in costs.items()
        if len(cost.curve) > 1 and getattr(cost.curve[-1], find) is not None
    }
    lines = []
    for title, cost in known.items():
        found = [getattr(point, find) for point in cost.curve]
        lines.append(draw_line(title, [point.usd for point in cost.curve], found))

    def count_found(cost: CampaignCost, usd: float) -> int | None:
        point = find_purchase(cost, usd)
        found: int | None = None if point is None else getattr(point, find)
        return found

    return Chart(
        id=name,
        kind="overlay",
        title=f"{FINDS[find]} against cost",
        caption=f"{FINDS[find]} found by accumulated cost, one line per campaign.",
        data={"x": "USD", "y": FINDS[find], "look": "steps", "lines": lines},
        table=ChartTable(
            ("USD", *known),
            [
                (usd, *(count_found(cost, usd) for cost in known.values()))
                for usd in list_amounts(known.values())
            ],
            ("–: no further cost.",),
        ),
    )


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
        """Return the name of the campaign in a legend."""
        return f"{self.campaign.id}: {self.campaign.spec.name}"


def make_overlays(compared: Sequence[Compared]) -> tuple[Chart, ...]:
    """Return the charts for which there are data."""
    charts = (
        make_rate_chart(compared),
        make_bill_chart("overlay-cost", "failures", {one.name: one.cost for one in compared}),
        make_severity_chart(compared),
        make_distance_chart(compared),
    )
    return tuple(chart for chart in charts if chart.table.rows)


def make_rate_chart(compared: Sequence[Compared]) -> Chart:
    """Return the chart of the failure rate, or share of failures, over episodes."""
    blocks = [(one.name, block) for one in compared for block in one.course.blocks]
    what = name_rates(block.failure_rate for _, block in blocks)
    lines = [
        draw_line(
            one.name,
            [(block.first + block.last) / 2.0 for block in one.course.blocks],
            [100.0 * block.failure_rate.share for block in one.course.blocks],
        )
        for one in compared
    ]
    return Chart(
        id="overlay-rate",
        kind="overlay",
        title=f"{what} over episodes",
        caption="By blocks of episodes; the table holds the 95 % intervals of random samples."
        + _explain_searches(compared),
        data={"x": "Episode", "y": f"{what} [%]", "look": "lines", "lines": lines},
        table=ChartTable(
            ("Campaign", "Episodes", what, "95 % interval"),
            [
                (
                    name,
                    format_span(block),
                    figures.format_share(block.failure_rate.value),
                    format_bounds(block.failure_rate),
                )
                for name, block in blocks[:MOST_ROWS]
            ],
            note_the_first(len(blocks)),
        ),
    )


def _explain_searches(compared: Sequence[Compared]) -> str:
    """Return what the lines of searches show; empty if every campaign is a random sample."""
    rates = [(one, block.failure_rate) for one in compared for block in one.course.blocks]
    # By campaign, each once, in the order of the legend.
    searches = dict.fromkeys(str(one.campaign.id) for one, rate in rates if not rate.sampled)
    if not searches:
        return ""
    return (
        f" The line of a search (campaign {', '.join(searches)}) is the share of failures among "
        "the episodes that it chose, and no failure rate under p(x)."
    )


def make_severity_chart(compared: Sequence[Compared]) -> Chart:
    """Return the chart of the failures' likelihood and severity."""
    points: dict[str, list[tuple[float, float]]] = {}
    for one in compared:
        failures = [row for row in one.rows if row.outcome.is_failure and row.severity]
        # Every n-th, rounded up, so that at most so many are left; evenly over the campaign.
        every = -(-len(failures) // MOST_POINTS) or 1
        points[one.name] = [
            (row.log_probability / max(row.steps, 1), row.severity or 0.0)
            for row in failures[::every]
        ]
    lines = [
        draw_line(name, [x for x, _ in each], [y for _, y in each]) for name, each in points.items()
    ]
    return Chart(
        id="overlay-severity",
        kind="overlay",
        title="Likelihood and severity of the failures",
        caption=(
            f"Each mark is a failure, at most {MOST_POINTS} of each campaign; farther to the right "
            "is likelier, farther up is worse."
        ),
        data={"x": "log p per step", "y": "Severity [m²/s²]", "look": "marks", "lines": lines},
        table=ChartTable(
            ("Campaign", "Failures drawn", "Median log p per step", "Median severity [m²/s²]"),
            [
                (name, len(each), *map(float, np.median(each, axis=0)))
                for name, each in points.items()
                if each
            ],
        ),
    )


def make_distance_chart(compared: Sequence[Compared]) -> Chart:
    """Return the chart of the distribution of robustness.

    The robustness of a function or of requirements does not have a unit.
    """
    units = {find_robustness_unit(one.campaign.spec) for one in compared}
    # One axis may show distances beside values that have no unit: the title says which have one.
    unit = " [m]" if units == {"m"} else " [m for distances]" if "m" in units else ""
    nothing = "0 m" if units == {"m"} else "0"
    measured = (
        (one.name, [row.robustness_m for row in one.rows if row.robustness_m is not None])
        for one in compared
    )
    known = [(name, found) for name, found in measured if found]
    lines = [
        draw_line(name, np.quantile(found, SHARES).tolist(), (100.0 * SHARES).tolist())
        for name, found in known
    ]
    return Chart(
        id="overlay-robustness",
        kind="overlay",
        title="Distribution of robustness",
        caption=f"Cumulative share of episodes by robustness; {nothing} is a failure.",
        data={
            "x": f"Robustness{unit}",
            "y": "Episodes [%]",
            "look": "lines",
            "lines": lines,
        },
        table=ChartTable(
            ("Campaign", "Episodes", *(f"{100 * share:.0f} %" for share in QUANTILES)),
            [
                (name, len(found), *map(float, np.quantile(found, QUANTILES)))
                for name, found in known
            ],
            (f"Quantiles of robustness{unit}.",),
        ),
    )


def draw_line(name: str, x: Sequence[float], y: Sequence[float | None]) -> dict[str, object]:
    """Return a campaign's line of a chart."""
    return {"name": name, "x": collect_floats(x), "y": collect_floats(y)}
