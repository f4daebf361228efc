"""What a failure costs, campaign beside campaign."""

from collections.abc import Sequence

from eigenfail.values import Summary
from eigenfail_api.dashboard import formats
from eigenfail_api.dashboard.views import cost_marks
from eigenfail_api.dashboard.views.charts import Chart

MOST_BARS = 25
REPLAY = "replay"


def cost_chart(summaries: Sequence[Summary]) -> Chart | None:
    """Cost per failure of the newest campaigns that have one, or a bound above zero."""
    found = [summary for summary in summaries if summary.method != REPLAY]
    priced = [summary for summary in found if summary.cost.at_least_usd]
    if not priced:
        return None
    shown = priced[:MOST_BARS]
    return Chart(
        id="cost-chart",
        kind="cost",
        title="Cost per failure",
        caption=(
            "USD per failure, log scale, with the 95 % interval that its failure rate gives: the "
            "time billed is taken as it was, and training again may cost another. An arrow is the "
            "lower bound of a campaign without failures. Replays find nothing new and are left out."
        ),
        data={"campaigns": [cost_point(summary) for summary in shown]},
        columns=("Campaign", "Method", *cost_marks.COLUMNS, "Failures", "Episodes"),
        rows=tuple(cost_row(summary) for summary in shown),
    )


def cost_point(summary: Summary) -> dict[str, object]:
    """A campaign's mark."""
    return cost_marks.mark(
        summary.cost,
        id=summary.campaign,
        name=summary.name,
        method=summary.method,
        failures=summary.counts.failures,
        completed=summary.counts.completed,
    )


def cost_row(summary: Summary) -> tuple[str, ...]:
    """The same as text."""
    return (
        f"{summary.campaign}: {summary.name}",
        summary.method,
        *cost_marks.cells(summary.cost),
        formats.integer(summary.counts.failures),
        formats.integer(summary.counts.completed),
    )
