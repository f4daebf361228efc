"""The addresses of the dashboard."""

from typing import Annotated

from fastapi import APIRouter, Query
from fastapi.responses import HTMLResponse

from eigenfail import plugins
from eigenfail.contracts import Store
from eigenfail.errors import EigenfailError
from eigenfail.values import (
    Campaign,
    CampaignSpec,
    Mission,
    Outcome,
    Page,
    Summary,
)
from eigenfail.values.records import EpisodeRow
from eigenfail.values.variation import read_variation
from eigenfail_api.dashboard import samples
from eigenfail_api.dashboard.rendering import page
from eigenfail_api.dashboard.views.analysis import analysis_view
from eigenfail_api.dashboard.views.campaign import Findings, campaign_view
from eigenfail_api.dashboard.views.episode import episode_view
from eigenfail_api.dashboard.views.lists import episode_list
from eigenfail_api.dashboard.views.measures import measures_view
from eigenfail_api.dashboard.views.overview import overview
from eigenfail_api.parameters import (
    LARGEST,
    AnalysisId,
    Before,
    CampaignId,
    EpisodeIndex,
    Stored,
)
from eigenfail_services.campaigns.course import course_of
from eigenfail_services.campaigns.proofs import proof
from eigenfail_services.campaigns.safety import safety_of
from eigenfail_services.campaigns.spending import spending_of
from eigenfail_services.campaigns.summary import summarise

router = APIRouter(include_in_schema=False, default_response_class=HTMLResponse)

CAMPAIGNS_ON_A_PAGE = 50
FAILURES_ON_A_PAGE = 25
ANALYSES_ON_A_PAGE = 20

AfterFailure = Annotated[int | None, Query(ge=0, le=LARGEST)]


@router.get("/")
def show_overview(store: Stored, before: Before = None) -> HTMLResponse:
    """All campaigns, newest first."""
    listed = store.campaigns.page(CAMPAIGNS_ON_A_PAGE, before)
    summaries = [summary_of(store, campaign) for campaign in listed.items]
    return page("overview.html", overview(listed, summaries, before))


@router.get("/campaigns/{campaign}")
def show_campaign(store: Stored, campaign: CampaignId) -> HTMLResponse:
    """One campaign."""
    seen = store.campaigns.get(campaign)
    found = Findings(
        campaign=seen,
        summary=summary_of(store, seen),
        course=course_of(store, seen),
        rows=samples.sample_episodes(store, seen),
        listed=failures_of(store, campaign, None),
        analyses=store.analyses.page(ANALYSES_ON_A_PAGE, None, campaign).items,
        events=tuple(samples.latest_events(store, campaign)),
    )
    return page("campaign.html", campaign_view(found))


@router.get("/campaigns/{campaign}/measures")
def show_measures(store: Stored, campaign: CampaignId) -> HTMLResponse:
    """Safety and cost of a campaign: its page asks for them once it stands."""
    seen = store.campaigns.get(campaign)
    view = measures_view(seen, safety_of(store, seen), spending_of(store, seen))
    return page("measures.html", view)


@router.get("/campaigns/{campaign}/failures")
def show_failures(store: Stored, campaign: CampaignId, after: AfterFailure = None) -> HTMLResponse:
    """Rows of the list of failures: a piece of a page."""
    seen = store.campaigns.get(campaign)
    view = episode_list(seen, failures_of(store, campaign, after), after)
    return page("failures.html", view)


@router.get("/campaigns/{campaign}/episodes/{index}")
def show_episode(store: Stored, campaign: CampaignId, index: EpisodeIndex) -> HTMLResponse:
    """One episode."""
    seen = store.campaigns.get(campaign)
    result = store.episodes.get(campaign, index)
    following = store.episodes.page(campaign, 1, index, Outcome.COLLISION).items
    next_failure = following[0].index if following else None
    view = episode_view(seen, result, mission_of(seen.spec, result.seed), next_failure)
    return page("episode.html", view)


@router.get("/analyses/{analysis}")
def show_analysis(store: Stored, analysis: AnalysisId) -> HTMLResponse:
    """One analysis."""
    seen = store.analyses.get(analysis)
    proven = proof(store, seen) if seen.result else None
    return page("analysis.html", analysis_view(seen, store.campaigns.get(seen.campaign), proven))


def summary_of(store: Store, campaign: Campaign) -> Summary:
    """The figures of a campaign so far."""
    return summarise(campaign, store.episodes.totals(campaign.id))


def failures_of(store: Store, campaign: int, after: int | None) -> Page[EpisodeRow]:
    """The next failures of the list."""
    return store.episodes.page(campaign, FAILURES_ON_A_PAGE, after, Outcome.COLLISION)


def mission_of(spec: CampaignSpec, seed: int) -> Mission | None:
    """Lanes and time step as the scenario tells them; None where it is not installed here."""
    try:
        plugin = plugins.load(plugins.SCENARIOS, spec.scenario)
        variation = read_variation(plugin.Parameters, spec.scenario_parameters)
        mission: Mission = plugin()(variation.draw(seed), seed).mission
    except EigenfailError:
        return None
    return mission
