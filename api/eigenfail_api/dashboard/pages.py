"""The addresses of the dashboard: all campaigns, and one."""

from functools import partial
from typing import Annotated, Literal

from fastapi import APIRouter, Header, Query
from fastapi.responses import HTMLResponse
from starlette.background import BackgroundTask

from eigenfail.contracts import Store
from eigenfail.values import Campaign, CampaignState, Summary
from eigenfail.values.worker import ACTIVE_S
from eigenfail_api.dashboard.episodes_page import failures_of
from eigenfail_api.dashboard.likelihood import MOST_FAILURES, reference_of
from eigenfail_api.dashboard.rendering import page
from eigenfail_api.dashboard.views.campaign import Findings, campaign_view
from eigenfail_api.dashboard.views.campaign_costs import REPLAY
from eigenfail_api.dashboard.views.crew import crew_view
from eigenfail_api.dashboard.views.measures import MeasuresView, measures_view
from eigenfail_api.dashboard.views.overview import Known, Wanted, overview
from eigenfail_api.parameters import Before, CampaignId, Stored
from eigenfail_services.campaigns.ahead import (
    Measured,
    begin,
    finish,
    is_done,
    measured,
    remembered,
)
from eigenfail_services.campaigns.course import course_of
from eigenfail_services.campaigns.crew import lately, present, staffing, stranded
from eigenfail_services.campaigns.peers import methods_of, peer_costs
from eigenfail_services.campaigns.summary import summaries_of, summarise
from eigenfail_services.store.clock import now_ms

router = APIRouter(include_in_schema=False, default_response_class=HTMLResponse)

CAMPAIGNS_ON_A_PAGE = 50
ANALYSES_ON_A_PAGE = 20
EVENTS_SHOWN = 30

# A form sends what is empty, too.
State = Annotated[CampaignState | Literal[""], Query()]
Words = Annotated[str, Query(max_length=200)]

# An open page sends it when it asks for itself again.
Again = Annotated[str | None, Header(alias="HX-Request", include_in_schema=False)]


@router.get("/")
def show_overview(
    store: Stored, state: State = "", method: Words = "", search: Words = "", before: Before = None
) -> HTMLResponse:
    """Campaigns, newest first."""
    wanted = Wanted(state or None, method or None, search.strip() or None, before)
    told = partial(staffing, store)
    return page("overview.html", overview(known(store, wanted), wanted), staffing=told)


def known(store: Store, wanted: Wanted) -> Known:
    """What the first page tells of."""
    latest, pools = store.events.last(), store.figures.pools()
    found = store.campaigns.page(
        CAMPAIGNS_ON_A_PAGE, wanted.before, wanted.state, where=wanted.where
    )
    return Known(
        page=found,
        summaries=summaries_of(store, found.items),
        groups=peer_costs(pools),
        methods=methods_of(pools),
        replays=sum(pool.campaigns for pool in pools if pool.method == REPLAY),
        here=present(store),
        lately=lately(store, ACTIVE_S),
        within_s=ACTIVE_S,
        stranded=stranded(store),
        latest=latest,
    )


@router.get("/campaigns/{campaign}")
def show_campaign(store: Stored, campaign: CampaignId, again: Again = None) -> HTMLResponse:
    """One campaign; its later part is begun beside it, and in it if that is known already."""
    latest, seen = store.events.last(), store.campaigns.get(campaign)
    begun = () if again else begin(store, seen)
    listed = failures_of(store, campaign, None)
    first = [row.index for row in listed.items[:MOST_FAILURES]]
    found = Findings(
        campaign=seen,
        summary=summary_of(store, seen),
        course=course_of(store, seen),
        rows=store.figures.samples(campaign),
        listed=listed,
        analyses=store.analyses.page(ANALYSES_ON_A_PAGE, None, campaign).items,
        events=tuple(store.events.latest(EVENTS_SHOWN, campaign)),
        latest=latest,
        here=present(store),
        stranded=tuple(each for each in stranded(store) if each.campaign == campaign),
        reference=reference_of(store, campaign, first),
        at_ms=now_ms(),
    )
    measures = measures_of(seen, remembered(store, seen)) if begun and is_done(begun) else None
    told = partial(staffing, store)
    response = page("campaign.html", campaign_view(found), measures=measures, staffing=told)
    response.background = BackgroundTask(finish, begun)
    return response


@router.get("/campaigns/{campaign}/measures")
def show_measures(store: Stored, campaign: CampaignId) -> HTMLResponse:
    """Safety, cost and workers of a campaign: its page asks for them once it stands."""
    seen = store.campaigns.get(campaign)
    return page("measures.html", measures_of(seen, measured(store, seen)))


def measures_of(campaign: Campaign, found: Measured) -> MeasuresView:
    """Safety, cost and workers of a campaign."""
    return measures_view(campaign, found.safety, found.cost, crew_view(found.workers))


def summary_of(store: Store, campaign: Campaign) -> Summary:
    """The figures of a campaign so far."""
    return summarise(campaign, store.episodes.totals(campaign.id))
