"""Two to twelve campaigns on one page."""

from collections.abc import Sequence

import msgspec

from eigenfail.values import Campaign, Comparison, Side, Summary
from eigenfail_api.dashboard import formats
from eigenfail_api.dashboard.views.charts import Chart
from eigenfail_api.dashboard.views.comparison import rate
from eigenfail_api.dashboard.views.copying import Copies
from eigenfail_api.dashboard.views.findings import Grid
from eigenfail_api.dashboard.views.picking import Chosen, Picker, named
from eigenfail_api.dashboard.views.states import CAMPAIGN_BADGES
from eigenfail_services.campaigns.comparison_groups import Group, Setting
from eigenfail_services.campaigns.comparison_words import chance

FIGURES = (
    "State",
    "Episodes",
    "Failure rate, 95 % interval",
    "USD per failure, 95 % interval",
    "Spent [USD]",
    "log p per step of the failures",
    "Mean severity [m²/s²]",
    "Episodes/s",
)


class Verdict(msgspec.Struct, frozen=True, kw_only=True):
    """One group against the first.

    Attributes:
        cells: of its row.
        address: of the two alone.
    """

    name: str
    cells: tuple[str, ...]
    address: str
    warnings: tuple[str, ...]


class ComparedView(msgspec.Struct, frozen=True, kw_only=True):
    """The page.

    Attributes:
        chosen: the campaigns, the first of them first.
        names: of the campaigns, as columns are headed.
        settings: those that are shown.
        other: of the page with the other settings shown.
        only: whether only those that differ are shown.
        verdicts: every group against the first.
    """

    picker: Picker
    chosen: tuple[Chosen, ...]
    names: tuple[str, ...]
    figures: Grid | None
    settings: tuple[Setting, ...]
    only: bool
    other: str
    first: str
    verdicts: tuple[Verdict, ...]
    charts: tuple[Chart, ...]
    copies: Copies | None


def figures(campaigns: Sequence[Campaign], summaries: Sequence[Summary]) -> Grid:
    """The figures of each campaign, a row for each."""
    columns = ("Campaign", *FIGURES)
    rows = (
        (named(campaign), *figures_of(campaign, summary))
        for campaign, summary in zip(campaigns, summaries, strict=True)
    )
    return Grid("Figures", columns, tuple(rows))


def figures_of(campaign: Campaign, summary: Summary) -> tuple[str, ...]:
    """In the order of `FIGURES`."""
    price = summary.cost
    bounds = f", {formats.interval(price.interval_usd)}" if price.interval_usd else ""
    return (
        CAMPAIGN_BADGES[campaign.state].word,
        formats.integer(campaign.counts.completed),
        rate(summary.failure_rate),
        formats.cost_per_failure(price).removesuffix(" USD") + bounds,
        formats.number(price.total_usd),
        formats.number(summary.log_probability_per_step),
        formats.number(summary.mean_severity),
        formats.number(summary.episodes_per_s),
    )


def verdicts(groups: Sequence[Group], found: Sequence[Comparison]) -> tuple[Verdict, ...]:
    """Every group against the first."""
    return tuple(
        Verdict(
            name=group_name(group),
            cells=(formats.signed(difference(each)), pairs(each), effect(each)),
            address=f"/comparison?a={ids(each.a)}&b={ids(each.b)}",
            warnings=each.warnings,
        )
        for group, each in zip(groups[1:], found, strict=True)
    )


def group_name(group: Group) -> str:
    """Its campaigns."""
    return "; ".join(map(named, group))


def ids(side: Side) -> str:
    """The campaigns of a side, as an address names them."""
    return ",".join(map(str, side.campaigns))


def difference(found: Comparison) -> str:
    """Of the failure rates."""
    if found.difference is None:
        return "no episode on a side"
    low, high = (
        f"{100.0 * end:+.1f}"
        for end in (found.difference.interval.low, found.difference.interval.high)
    )
    told = (
        ""
        if found.difference.interval.low <= 0.0 <= found.difference.interval.high
        else ", differs"
    )
    return f"{100.0 * found.difference.value:+.1f} % [{low}, {high}]{told}"


def pairs(found: Comparison) -> str:
    """Under the same noise."""
    if found.pairs is None:
        return f"not paired: {found.unpaired_because}"
    seen = found.pairs
    return (
        f"{formats.counted(seen.n, 'pair')}: {seen.only_b} only here, {seen.only_a} only in the "
        f"first, {chance(seen.p_value)}"
    )


def effect(found: Comparison) -> str:
    """Over campaigns of several seeds."""
    if found.effect is None:
        return "takes two seeds of each"
    return f"{found.effect.a12:.2f}, {found.effect.magnitude}"
