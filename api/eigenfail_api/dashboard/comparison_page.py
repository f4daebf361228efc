"""The comparison page: two groups of campaigns, or all selected campaigns."""

from collections.abc import Iterator, Sequence
from itertools import islice
from typing import Annotated, NamedTuple
from urllib.parse import urlencode

from fastapi import APIRouter, Depends, Query, Request
from fastapi.responses import HTMLResponse
from pydantic import Field

from eigenfail.presentation.campaigns import tabulate_compared, tabulate_sides
from eigenfail.presentation.figures import (
    UNKNOWN,
    count_noun,
    format_number,
    format_signed,
    format_signed_interval,
    put_minus_signs,
)
from eigenfail.presentation.tables import transpose
from eigenfail.values.campaign import Campaign, CampaignFilter
from eigenfail.values.comparison import Comparison, Side
from eigenfail.values.summary import CampaignCost
from eigenfail_api.dashboard.charts import spread
from eigenfail_api.dashboard.copying import Service, format_curl, read_service
from eigenfail_api.dashboard.overlays import Compared, make_bill_charts, make_overlays
from eigenfail_api.dashboard.rendering import page
from eigenfail_api.parameters import IDS, LARGEST, Stored
from eigenfail_api.routes.analyses import COMPARISONS, parse_ids
from eigenfail_services.campaigns.costs import find_spending
from eigenfail_services.campaigns.summary import find_course, summarise_campaigns
from eigenfail_services.comparison import comparability, sides
from eigenfail_services.store.store import Store

CampaignIds = Sequence[int]


def name_column(campaign: Campaign) -> str:
    """Return the head of a campaign's column."""
    return f"{campaign.id}: {campaign.spec.name}"


def make_address(campaigns: CampaignIds, only: bool, wanted: str) -> str:
    """Return the address of the page that compares these campaigns."""
    query: list[tuple[str, str | int]] = [("campaign", each) for each in campaigns]
    query += [("q", wanted)] if wanted else []
    return f"/comparison?{urlencode([*query, ('diff', str(only).lower())])}"


def group_name(group: comparability.Group) -> str:
    """Return the name of a group: the heads of its campaigns."""
    return "; ".join(map(name_column, group))


def join_ids(side: Side) -> str:
    """Return the ids of a side's campaigns as an address contains them."""
    return ",".join(map(str, side.campaigns))


def describe_difference(found: Comparison) -> str:
    """Return the difference of the failure rates of two random samples as text."""
    # Nothing was completed on a side.
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


def describe_pairs(found: Comparison) -> str:
    """Return the comparison of episodes with equal noise as text."""
    if found.pairs is None:
        return f"not paired: {found.unpaired_because}"
    seen = found.pairs
    return (
        f"{count_noun(seen.n, 'pair')}: {seen.only_b} only here, {seen.only_a} only in the "
        f"baseline, {sides.format_p_value(seen.p_value)}"
    )


router = APIRouter(include_in_schema=False, default_response_class=HTMLResponse)

MAX_CAMPAIGNS_SEARCHED = 1_000
"""Newest campaigns among which names are searched for."""

LISTED = 30

MOST_DRAWN = 5_000
"""Episodes of each campaign that distributions are drawn of."""

Ids = Annotated[str | None, Query(pattern=IDS)]
Picked = Annotated[list[Annotated[int, Field(ge=1, le=LARGEST)]], Query(default_factory=list)]
Wanted = Annotated[str, Query(max_length=200)]


class Wish(NamedTuple):
    """The query of the comparison page.

    Attributes:
        campaign: campaigns that were picked.
        diff: whether only settings that differ are shown.
        q: text that the names of the offered campaigns contain.
    """

    campaign: Picked
    diff: bool = True
    q: Wanted = ""


@router.get("/comparison", dependencies=[COMPARISONS])
def show_comparison(
    request: Request,
    store: Stored,
    wished: Annotated[Wish, Depends()],
    a: Ids = None,
    b: Ids = None,
) -> HTMLResponse:
    """Serve the comparison of two groups of campaigns, or of all selected ones."""
    # Two groups come from a link or the form; picked campaigns from the list.
    if a and b and not wished.campaign:
        found = sides.compare(store, parse_ids(a), parse_ids(b))
        bills = (list_costs(store, found.a), list_costs(store, found.b))
        return page(
            "comparison.html",
            found,
            a=a,
            b=b,
            sides=transpose(tabulate_sides(found, bills), "Figure"),
            charts=make_bill_charts(*bills),
            curl=make_curl(read_service(request), a, b),
        )
    view = make_compared_view(store, wished, read_service(request))
    return page("compared.html", view, a=a or "", b=b or "")


def list_costs(store: Store, side: Side) -> tuple[CampaignCost, ...]:
    """Return the cost of each campaign of a side."""
    return tuple(find_spending(store, store.campaigns.get(each)) for each in side.campaigns)


def make_compared_view(store: Store, wished: Wish, service: Service) -> dict[str, object]:
    """Return what the page shows of the selected campaigns; fewer than two are not compared.

    Raises:
        InvalidValue: too many were picked.
        NotFound: a selected campaign does not exist.
    """
    campaigns = sides.read_distinct_campaigns(wished.campaign, store)
    ids = [each.id for each in campaigns]
    # Those that are picked stand first, in their order.
    found = islice(find_matching(store, ids, wished.q), LISTED)
    others = sorted(found, key=lambda each: -each.id)

    def link(some: CampaignIds, *, only: bool = wished.diff) -> str:
        return make_address(some, only, wished.q)

    chosen = []
    for each in campaigns:
        rest = [other for other in ids if other != each.id]
        chosen.append((each, "" if each.id == ids[0] else link([each.id, *rest]), link(rest)))
    view: dict[str, object] = {
        "choices": [*campaigns, *others],
        "ids": ids,
        "wanted": wished.q,
        "limits": f"{sides.FEWEST} to {sides.MOST}",
        "chosen": chosen,
        "is_enough": len(campaigns) >= sides.FEWEST,
    }
    if len(campaigns) < sides.FEWEST:
        return view
    groups = sides.group_by_seed(campaigns)
    settings = comparability.compare_settings(campaigns)
    summaries = summarise_campaigns(store, campaigns)
    pair = [",".join(str(each.id) for each in group) for group in groups[:2]]
    return view | {
        "names": [name_column(each) for each in campaigns],
        "figures": tabulate_compared(campaigns, summaries),
        "settings": [each for each in settings if each.differs or not wished.diff],
        "only": wished.diff,
        "other": link(ids, only=not wished.diff),
        "first": group_name(groups[0]),
        "verdicts": [
            (
                group_name(group),
                found,
                (
                    put_minus_signs(describe_difference(found)),
                    describe_pairs(found),
                    f"{format_number(found.effect.a12)}, {found.effect.magnitude}"
                    if found.effect
                    else "needs four seeds per group",
                ),
                f"/comparison?a={join_ids(found.a)}&b={join_ids(found.b)}",
            )
            for group, found in zip(groups[1:], sides.against_first(store, groups), strict=True)
        ],
        "charts": make_overlays(
            [
                Compared(
                    campaign=each,
                    course=find_course(store, each),
                    cost=find_spending(store, each),
                    rows=spread(store, each, most=MOST_DRAWN).rows,
                )
                for each in campaigns
            ]
        ),
        "curl": make_curl(service, *pair) if len(groups) >= sides.FEWEST else "",
    }


def make_curl(service: Service, a: str, b: str) -> str:
    """Return the command that compares two groups, whose ids are joined by commas."""
    return format_curl(service, f"/comparisons?{urlencode({'a': a, 'b': b})}")


def find_matching(store: Store, besides: Sequence[int], wanted: str) -> Iterator[Campaign]:
    """Yield the newest campaigns whose name contains the text, or whose id it is."""
    listed = store.campaigns.iterate(CampaignFilter(archived=False))
    # In Python: names are compared without regard to case in all alphabets, which SQLite cannot.
    for each in islice(listed, MAX_CAMPAIGNS_SEARCHED):
        is_named = wanted.lower() in each.spec.name.lower() or wanted == str(each.id)
        if is_named and each.id not in besides:
            yield each
