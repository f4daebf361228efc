"""The comparison page: two groups of campaigns, or all selected campaigns."""

from collections.abc import Callable, Iterator, Sequence
from typing import Annotated, NamedTuple
from urllib.parse import urlencode

import msgspec
from fastapi import APIRouter, Depends, Query, Request
from fastapi.responses import HTMLResponse
from pydantic import Field

from eigenfail import values
from eigenfail.presentation.campaigns import tabulate_compared, tabulate_sides
from eigenfail.presentation.figures import (
    UNKNOWN,
    count_noun,
    format_number,
    format_signed,
    format_signed_interval,
    put_minus_signs,
)
from eigenfail.presentation.tables import Table, transpose
from eigenfail.values.campaign import CampaignFilter
from eigenfail_api.dashboard.charts import Chart, sample_episodes
from eigenfail_api.dashboard.copying import Service, format_curl, read_service
from eigenfail_api.dashboard.overlays import Compared, make_bill_charts, make_overlays
from eigenfail_api.dashboard.rendering import Badge, make_campaign_badge, page
from eigenfail_api.parameters import IDS, LARGEST, Stored
from eigenfail_api.routes.analyses import COMPARISONS, parse_ids
from eigenfail_services.campaigns.costs import find_spending
from eigenfail_services.campaigns.summary import find_course, summarise
from eigenfail_services.comparison import comparability, sides
from eigenfail_services.store import Store

CampaignIds = Sequence[int]


class CampaignChoice(msgspec.Struct, frozen=True, kw_only=True):
    """A campaign that can be picked."""

    id: int
    name: str
    about: str
    badge: Badge
    is_picked: bool


class Picker(msgspec.Struct, frozen=True, kw_only=True):
    """The list to pick from.

    Attributes:
        wanted: what names are to contain; empty for all.
        words: how many are picked, and how many can be.
    """

    choices: tuple[CampaignChoice, ...]
    wanted: str
    words: str


class Chosen(msgspec.Struct, frozen=True, kw_only=True):
    """A campaign that is compared.

    Attributes:
        first: address of the comparison in which the others are held against this one; empty if
            they are already.
        without: address of the comparison without it.
    """

    name: str
    about: str
    badge: Badge
    first: str
    without: str


def make_picker(shown: Sequence[values.Campaign], ids: CampaignIds, wanted: str) -> Picker:
    """Return the list of campaigns to choose from, with the chosen ones first in their order."""
    places = {each: place for place, each in enumerate(ids)}
    ordered = sorted(shown, key=lambda each: (places.get(each.id, len(ids)), -each.id))
    words = f"{len(ids)} selected; {sides.FEWEST} to {sides.MOST} can be compared."
    return Picker(
        choices=tuple(make_listed_choice(each, ids) for each in ordered), wanted=wanted, words=words
    )


def make_listed_choice(campaign: values.Campaign, ids: CampaignIds) -> CampaignChoice:
    """Return a campaign of the list."""
    return CampaignChoice(
        id=campaign.id,
        name=campaign.spec.name,
        about=describe_spec(campaign.spec),
        badge=make_campaign_badge(campaign.state, campaign.counts),
        is_picked=campaign.id in ids,
    )


def list_chosen(
    campaigns: Sequence[values.Campaign], only: bool, wanted: str
) -> tuple[Chosen, ...]:
    """Return the campaigns that are compared, on a page with these settings and this search."""
    ids = [each.id for each in campaigns]
    return tuple(
        make_choice(each, ids, lambda some: make_address(some, only, wanted)) for each in campaigns
    )


def make_choice(
    campaign: values.Campaign, ids: CampaignIds, at: Callable[[CampaignIds], str]
) -> Chosen:
    """One of them, with how to have it first and how to leave it out."""
    others = [each for each in ids if each != campaign.id]
    return Chosen(
        name=name_column(campaign),
        about=describe_spec(campaign.spec),
        badge=make_campaign_badge(campaign.state, campaign.counts),
        first="" if campaign.id == ids[0] else at([campaign.id, *others]),
        without=at(others),
    )


def describe_spec(spec: values.CampaignSpec) -> str:
    """Return the method, planner, scenario and seed of a campaign, for lists of equal names."""
    return f"{spec.method}, {spec.planner} in {spec.scenario}, seed {spec.seed}"


def name_column(campaign: values.Campaign) -> str:
    """As a column is headed."""
    return f"{campaign.id}: {campaign.spec.name}"


def make_address(campaigns: CampaignIds, only: bool, wanted: str) -> str:
    """Return the address of the page that compares these campaigns."""
    query: list[tuple[str, str | int]] = [("campaign", each) for each in campaigns]
    query += [("q", wanted)] if wanted else []
    return f"/comparison?{urlencode([*query, ('diff', str(only).lower())])}"


class ComparisonVerdict(msgspec.Struct, frozen=True, kw_only=True):
    """One group against the first.

    Attributes:
        cells: cells of its row.
        address: address of the comparison of these two alone.
    """

    name: str
    cells: tuple[str, ...]
    address: str
    warnings: tuple[str, ...]


class ComparedView(msgspec.Struct, frozen=True, kw_only=True):
    """The page.

    Attributes:
        chosen: the campaigns, the first of them first.
        names: names of the campaigns, the heads of the columns.
        settings: those that are shown.
        other: of the page with the other settings shown.
        only: whether only those that differ are shown.
        verdicts: every group against the first.
    """

    picker: Picker
    chosen: tuple[Chosen, ...]
    names: tuple[str, ...]
    figures: Table | None
    settings: tuple[comparability.SettingValues, ...]
    only: bool
    other: str
    first: str
    verdicts: tuple[ComparisonVerdict, ...]
    charts: tuple[Chart, ...]
    curl: str


def list_verdicts(
    groups: Sequence[comparability.Group], found: Sequence[values.Comparison]
) -> tuple[ComparisonVerdict, ...]:
    """Return the comparison of every group with the first."""
    return tuple(
        ComparisonVerdict(
            name=group_name(group),
            cells=(
                put_minus_signs(describe_difference(each)),
                describe_pairs(each),
                describe_effect(each),
            ),
            address=f"/comparison?a={join_ids(each.a)}&b={join_ids(each.b)}",
            warnings=each.warnings,
        )
        for group, each in zip(groups[1:], found, strict=True)
    )


def group_name(group: comparability.Group) -> str:
    """Its campaigns."""
    return "; ".join(map(name_column, group))


def join_ids(side: values.Side) -> str:
    """Return the ids of a side's campaigns as an address contains them."""
    return ",".join(map(str, side.campaigns))


def describe_difference(found: values.Comparison) -> str:
    """Return the difference of the failure rates of two random samples as text."""
    if found.difference is None:
        return "no episode on a side"
    if not found.is_sampled:
        # The share of the episodes that a search chose estimates no failure rate under p(x), so
        # that its difference from a rate, or from the share of another search, estimates nothing.
        return f"{UNKNOWN} not comparable: the episodes of a search are no random sample"
    value = f"{format_signed(100.0 * found.difference.value)} %"
    interval = format_signed_interval(found.difference.interval, 100.0)
    basis = ", over pairs" if found.difference.is_paired else ""
    verdict = ", differs" if sides.is_beyond_chance(found.difference, found.pairs) else ""
    return f"{value} {interval}{basis}{verdict}"


def describe_pairs(found: values.Comparison) -> str:
    """Return the comparison of episodes with equal noise as text."""
    if found.pairs is None:
        return f"not paired: {found.unpaired_because}"
    seen = found.pairs
    return (
        f"{count_noun(seen.n, 'pair')}: {seen.only_b} only here, {seen.only_a} only in the "
        f"baseline, {sides.format_p_value(seen.p_value)}"
    )


def describe_effect(found: values.Comparison) -> str:
    """Return the effect over campaigns of several seeds as text."""
    if found.effect is None:
        return "needs four seeds per group"
    return f"{format_number(found.effect.a12)}, {found.effect.magnitude}"


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
    sides: Table
    charts: tuple[Chart, ...]
    distinctions: tuple[values.Distinction, ...]


class Bills(msgspec.Struct, frozen=True):
    """What each campaign of each side cost."""

    a: tuple[values.CampaignCost, ...]
    b: tuple[values.CampaignCost, ...]


def make_comparison_view(found: values.Comparison, bills: Bills, a: str, b: str) -> ComparisonView:
    """Return the page of a comparison."""
    return ComparisonView(
        a=a,
        b=b,
        sentences=found.sentences,
        warnings=found.warnings,
        sides=transpose(tabulate_sides(found, (bills.a, bills.b)), "Figure"),
        charts=make_bill_charts(bills.a, bills.b),
        distinctions=found.distinctions,
    )


router = APIRouter(include_in_schema=False, default_response_class=HTMLResponse)

MAX_CAMPAIGNS_SEARCHED = 1_000
"""Newest campaigns among which names are searched for."""

LISTED = 30

Ids = Annotated[str | None, Query(pattern=IDS)]
Picked = Annotated[list[Annotated[int, Field(ge=1, le=LARGEST)]], Query(default_factory=list)]
Wanted = Annotated[str, Query(max_length=200)]


class Wish(NamedTuple):
    """The query of the comparison page.

    Attributes:
        campaigns: campaigns that were picked.
        only: whether only settings that differ are shown.
        named: what the names of those to pick from contain.
    """

    campaigns: Sequence[int]
    only: bool
    named: str


def read_wish(
    campaign: Picked,
    diff: bool = True,  # a parameter of the address
    q: Wanted = "",
) -> Wish:
    """Return the campaigns, settings and search that an address requests."""
    return Wish(campaign, diff, q)


@router.get("/comparison", dependencies=[COMPARISONS])
def show_comparison(
    request: Request,
    store: Stored,
    wished: Annotated[Wish, Depends(read_wish)],
    a: Ids = None,
    b: Ids = None,
) -> HTMLResponse:
    """Serve the comparison of two groups of campaigns, or of all selected ones."""
    if a and b and not wished.campaigns:
        found = sides.compare(store, parse_ids(a), parse_ids(b))
        bills = Bills(list_costs(store, found.a), list_costs(store, found.b))
        view = make_comparison_view(found, bills, a, b)
        return page("comparison.html", view, curl=make_curl(read_service(request), a, b))
    return page(
        "compared.html",
        make_compared_view(store, wished, read_service(request)),
        a=a or "",
        b=b or "",
    )


def list_costs(store: Store, side: values.Side) -> tuple[values.CampaignCost, ...]:
    """Return the cost of each campaign of a side."""
    return tuple(find_spending(store, store.campaigns.get(each)) for each in side.campaigns)


def make_compared_view(store: Store, wished: Wish, service: Service) -> ComparedView:
    """Return the page for the selected campaigns; fewer than two give the request to select more.

    Raises:
        InvalidValue: too many were picked.
        NotFound: there is no such campaign.
    """
    campaigns, only = sides.pick_campaigns(wished.campaigns, store), wished.only
    ids = [each.id for each in campaigns]
    listed = make_picker([*campaigns, *find_matching(store, ids, wished.named)], ids, wished.named)
    is_enough = len(campaigns) >= sides.FEWEST
    found = sides.group_by_seed(campaigns) if is_enough else ()
    every = comparability.compare_settings(campaigns) if is_enough else ()
    compared = [read_compared(store, each) for each in campaigns] if is_enough else []
    summaries = [summarise(each, store.episodes.totals(each.id)) for each in campaigns]
    pair = [",".join(str(each.id) for each in group) for group in found[:2]]
    return ComparedView(
        picker=listed,
        chosen=list_chosen(campaigns, only, wished.named),
        names=tuple(map(name_column, campaigns)),
        figures=tabulate_compared(campaigns, summaries) if is_enough else None,
        settings=tuple(each for each in every if each.differs or not only),
        only=only,
        other=make_address(ids, not only, wished.named),
        first=group_name(found[0]) if found else "",
        verdicts=list_verdicts(found, sides.against_first(store, found)) if found else (),
        charts=make_overlays(compared),
        curl=make_curl(service, *pair) if len(found) >= sides.FEWEST else "",
    )


def make_curl(service: Service, a: str, b: str) -> str:
    """Return the command that compares two groups, whose ids are joined by commas."""
    return format_curl(service, f"/comparisons?{urlencode({'a': a, 'b': b})}")


def read_compared(store: Store, campaign: values.Campaign) -> Compared:
    """Read the figures of a campaign that the charts draw."""
    return Compared(
        campaign=campaign,
        course=find_course(store, campaign),
        cost=find_spending(store, campaign),
        rows=sample_episodes(store, campaign),
    )


def find_matching(store: Store, besides: Sequence[int], wanted: str) -> list[values.Campaign]:
    """Return the newest campaigns whose name contains the text, or whose id it is."""
    found = (
        each
        for each in iterate_newest(store)
        if each.id not in besides
        and (wanted.lower() in each.spec.name.lower() or wanted == str(each.id))
    )
    return [each for _, each in zip(range(LISTED), found, strict=False)]


def iterate_newest(store: Store) -> Iterator[values.Campaign]:
    """Yield the newest campaigns, page by page."""
    before: int | None = None
    for _ in range(MAX_CAMPAIGNS_SEARCHED // 100):
        listed = store.campaigns.page(100, before, CampaignFilter(archived=False))
        yield from listed.items
        before = listed.next
        if before is None:
            return
