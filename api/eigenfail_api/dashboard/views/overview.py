"""All campaigns at a glance."""

from collections.abc import Sequence

import msgspec

from eigenfail.values import Campaign, Page, Summary
from eigenfail_api.dashboard import formats
from eigenfail_api.dashboard.views.charts import Chart, rounded
from eigenfail_api.dashboard.views.summaries import Figure, Standing, standing

MOST_BARS = 25
REPLAY = "replay"


class Overview(msgspec.Struct, frozen=True):
    """The first page.

    Attributes:
        before: cursor of this page; None on the first.
        older: cursor of the next one.
    """

    lines: tuple[Standing, ...]
    tiles: tuple[tuple[str, Figure], ...]
    costs: Chart | None
    before: int | None
    older: int | None
    is_open: bool


def overview(page: Page[Campaign], summaries: Sequence[Summary], before: int | None) -> Overview:
    """The page for some campaigns, newest first, and their summaries in the same order."""
    lines = tuple(map(standing, page.items, summaries))
    return Overview(
        lines=lines,
        tiles=tiles(page.items, summaries),
        costs=cost_chart(summaries),
        before=before,
        older=page.next,
        is_open=any(line.is_open for line in lines),
    )


def tiles(
    campaigns: Sequence[Campaign], summaries: Sequence[Summary]
) -> tuple[tuple[str, Figure], ...]:
    """Sums over the campaigns of the page; failures that were replayed are counted once."""
    running = sum(campaign.state == "running" for campaign in campaigns)
    completed = sum(campaign.counts.completed for campaign in campaigns)
    failures = sum(
        campaign.counts.failures for campaign in campaigns if campaign.spec.method != REPLAY
    )
    spent = sum(summary.cost.total_usd for summary in summaries)
    return (
        ("Campaigns", Figure(formats.integer(len(campaigns)), (f"{running} running",))),
        ("Episodes", Figure(formats.integer(completed), ("completed, replays too",))),
        ("Failures", Figure(formats.integer(failures), ("collisions found; replays aside",))),
        ("Spent", Figure(f"{formats.number(spent)} USD", ("instance-hours × price",))),
    )


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
            "USD per failure with its 95 % interval, log scale; an arrow is the lower bound of a "
            "campaign without failures. Replays find nothing new and are left out."
        ),
        data={"campaigns": [cost_point(summary) for summary in shown]},
        columns=("Campaign", "Method", "USD per failure", "95 % interval", "Failures", "Episodes"),
        rows=tuple(cost_row(summary) for summary in shown),
    )


def cost_point(summary: Summary) -> dict[str, object]:
    """A campaign's mark."""
    price = summary.cost
    bounds = price.interval_usd
    value, low, high, at_least = rounded(
        (
            price.per_failure_usd,
            bounds.low if bounds else None,
            bounds.high if bounds else None,
            price.at_least_usd,
        )
    )
    return {
        "id": summary.campaign,
        "name": summary.name,
        "method": summary.method,
        "value": value,
        "low": low,
        "high": high,
        "at_least": at_least,
        "failures": summary.counts.failures,
        "completed": summary.counts.completed,
    }


def cost_row(summary: Summary) -> tuple[str, ...]:
    """The same as text."""
    price = summary.cost
    bounds = formats.interval(price.interval_usd) if price.interval_usd else "lower bound (95 %)"
    return (
        f"{summary.campaign}: {summary.name}",
        summary.method,
        formats.cost_per_failure(price).removesuffix(" USD"),
        bounds,
        formats.integer(summary.counts.failures),
        formats.integer(summary.counts.completed),
    )
