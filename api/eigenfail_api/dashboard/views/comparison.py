"""Two groups of campaigns, side by side."""

import msgspec

from eigenfail.values import CampaignCost, Comparison, Distinction, Rate, Side
from eigenfail_api.dashboard import formats
from eigenfail_api.dashboard.views.bill_charts import bill_charts
from eigenfail_api.dashboard.views.bills import NAMES as BILL_NAMES
from eigenfail_api.dashboard.views.bills import bill
from eigenfail_api.dashboard.views.charts import Chart


class ComparisonLine(msgspec.Struct, frozen=True):
    """A figure of both sides."""

    name: str
    a: str
    b: str


class ComparisonView(msgspec.Struct, frozen=True, kw_only=True):
    """The page of a comparison.

    Attributes:
        a: ids of one side, as they were asked for.
        b: of the other.
    """

    a: str
    b: str
    sentences: tuple[str, ...]
    warnings: tuple[str, ...]
    lines: tuple[ComparisonLine, ...]
    charts: tuple[Chart, ...]
    distinctions: tuple[Distinction, ...]


class Bills(msgspec.Struct, frozen=True):
    """What each campaign of each side cost."""

    a: tuple[CampaignCost, ...]
    b: tuple[CampaignCost, ...]


def comparison_view(found: Comparison, bills: Bills, a: str, b: str) -> ComparisonView:
    """The page."""
    return ComparisonView(
        a=a,
        b=b,
        sentences=found.sentences,
        warnings=found.warnings,
        lines=(
            *map(ComparisonLine, NAMES, column(found.a), column(found.b)),
            *map(ComparisonLine, BILL_NAMES, bill(bills.a), bill(bills.b)),
        ),
        charts=bill_charts(bills.a, bills.b),
        distinctions=found.distinctions,
    )


NAMES = (
    "Campaigns",
    "Episodes",
    "Failures",
    "Failure rate, 95 % interval",
    "USD per failure, 95 % interval",
    "log p per step of the failures",
    "Mean severity [m²/s²]",
)


def column(side: Side) -> tuple[str, ...]:
    """The figures of a side, in the order of `NAMES`."""
    price = side.cost
    bounds = f", {formats.interval(price.interval_usd)}" if price.interval_usd else ""
    return (
        ", ".join(map(str, side.campaigns)),
        formats.integer(side.completed),
        formats.integer(side.failures),
        rate(side.failure_rate),
        formats.cost_per_failure(price).removesuffix(" USD") + bounds,
        formats.number(side.log_probability_per_step),
        formats.number(side.mean_severity),
    )


def rate(found: Rate | None) -> str:
    """A failure rate with its interval."""
    if found is None:
        return formats.NONE
    return f"{formats.percent(found.value)}, {formats.rate_interval(found)}"
