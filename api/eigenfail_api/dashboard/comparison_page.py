"""The address of the comparison."""

from collections.abc import Iterator, Sequence
from typing import Annotated, NamedTuple

from fastapi import APIRouter, Depends, Query, Request
from fastapi.responses import HTMLResponse
from pydantic import Field

from eigenfail.contracts import Store
from eigenfail.values import Campaign, CampaignCost, Side
from eigenfail_api.dashboard.rendering import page
from eigenfail_api.dashboard.samples import sample_episodes
from eigenfail_api.dashboard.views.compared import (
    ComparedView,
    figures,
    group_name,
    verdicts,
)
from eigenfail_api.dashboard.views.comparison import Bills, comparison_view
from eigenfail_api.dashboard.views.copying import Asked, Copies, Service, copies, service_of
from eigenfail_api.dashboard.views.overlays import Compared, overlays
from eigenfail_api.dashboard.views.picking import address, all_chosen, named, picker
from eigenfail_api.parameters import IDS, LARGEST, Stored
from eigenfail_api.routes.comparisons import numbers
from eigenfail_services.campaigns.comparison import compare
from eigenfail_services.campaigns.comparison_groups import (
    FEWEST,
    against_first,
    groups,
    picked,
    settings,
)
from eigenfail_services.campaigns.course import course_of
from eigenfail_services.campaigns.spending import spending_of
from eigenfail_services.campaigns.summary import summarise

router = APIRouter(include_in_schema=False, default_response_class=HTMLResponse)

LOOKED_AT = 1_000
"""Newest campaigns among which names are looked for."""

LISTED = 30

Ids = Annotated[str | None, Query(pattern=IDS)]
Picked = Annotated[list[Annotated[int, Field(ge=1, le=LARGEST)]], Query(default_factory=list)]
Wanted = Annotated[str, Query(max_length=200)]


class Wish(NamedTuple):
    """What is asked of the page.

    Attributes:
        campaigns: that were picked.
        only: whether only settings that differ are shown.
        named: what the names of those to pick from contain.
    """

    campaigns: Sequence[int]
    only: bool
    named: str


def wish(
    campaign: Picked,
    diff: bool = True,  # a parameter of the address
    q: Wanted = "",
) -> Wish:
    """What the address asks for."""
    return Wish(campaign, diff, q)


@router.get("/comparison")
def show_comparison(
    request: Request,
    store: Stored,
    wished: Annotated[Wish, Depends(wish)],
    a: Ids = None,
    b: Ids = None,
) -> HTMLResponse:
    """Campaigns side by side: two groups of them, or all that were picked."""
    if a and b and not wished.campaigns:
        found = compare(store, numbers(a), numbers(b))
        bills = Bills(costs(store, found.a), costs(store, found.b))
        asked = Asked(method="GET", path="/comparisons", query={"a": a, "b": b})
        view = comparison_view(found, bills, a, b)
        return page("comparison.html", view, copies=copies(service_of(request), asked))
    return page(
        "compared.html", compared_view(store, wished, service_of(request)), a=a or "", b=b or ""
    )


def costs(store: Store, side: Side) -> tuple[CampaignCost, ...]:
    """What each campaign of a side cost."""
    return tuple(spending_of(store, store.campaigns.get(each)) for each in side.campaigns)


def compared_view(store: Store, wished: Wish, service: Service) -> ComparedView:
    """The page for the campaigns that were picked; with fewer than two it asks for more.

    Raises:
        InvalidValue: too many were picked.
        NotFound: there is no such campaign.
    """
    campaigns, only = picked(wished.campaigns, store), wished.only
    ids = [each.id for each in campaigns]
    listed = picker([*campaigns, *matching(store, ids, wished.named)], ids, wished.named)
    is_enough = len(campaigns) >= FEWEST
    found = groups(campaigns) if is_enough else ()
    every = settings(campaigns) if is_enough else ()
    compared = [known(store, each) for each in campaigns] if is_enough else []
    summaries = [summarise(each, store.episodes.totals(each.id)) for each in campaigns]
    return ComparedView(
        picker=listed,
        chosen=all_chosen(campaigns, only, wished.named),
        names=tuple(map(named, campaigns)),
        figures=figures(campaigns, summaries) if is_enough else None,
        settings=tuple(each for each in every if each.differs or not only),
        only=only,
        other=address(ids, not only, wished.named),
        first=group_name(found[0]) if found else "",
        verdicts=verdicts(found, against_first(store, found)) if found else (),
        charts=overlays(compared),
        copies=copies_of(found, service),
    )


def copies_of(found: Sequence[tuple[Campaign, ...]], service: Service) -> Copies | None:
    """The comparison of the first two groups, for programs."""
    if len(found) < FEWEST:
        return None
    a, b = (",".join(str(each.id) for each in group) for group in found[:2])
    return copies(service, Asked(method="GET", path="/comparisons", query={"a": a, "b": b}))


def known(store: Store, campaign: Campaign) -> Compared:
    """What is drawn of a campaign."""
    return Compared(
        campaign=campaign,
        course=course_of(store, campaign),
        cost=spending_of(store, campaign),
        rows=sample_episodes(store, campaign),
    )


def matching(store: Store, besides: Sequence[int], wanted: str) -> list[Campaign]:
    """The newest campaigns whose name contains the words, or whose id they are."""
    found = (
        each
        for each in newest(store)
        if each.id not in besides
        and (wanted.lower() in each.spec.name.lower() or wanted == str(each.id))
    )
    return [each for _, each in zip(range(LISTED), found, strict=False)]


def newest(store: Store) -> Iterator[Campaign]:
    """The newest campaigns, page by page."""
    before: int | None = None
    for _ in range(LOOKED_AT // 100):
        listed = store.campaigns.page(100, before)
        yield from listed.items
        before = listed.next
        if before is None:
            return
