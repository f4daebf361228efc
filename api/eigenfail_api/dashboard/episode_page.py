"""The addresses of single episodes and of what is done with them."""

from typing import Annotated

from anyio.to_thread import run_sync
from fastapi import APIRouter, Query
from fastapi.responses import HTMLResponse

from eigenfail import plugins
from eigenfail.contracts import Store
from eigenfail.errors import EigenfailError, NoisePruned, NotFound, ServiceBusy
from eigenfail.values import CampaignSpec, EpisodeResult, Mission
from eigenfail.values.variation import read_variation
from eigenfail.versions import differences
from eigenfail_api.dashboard.episodes_page import FAILURES
from eigenfail_api.dashboard.rendering import page
from eigenfail_api.dashboard.views.account import account_view, no_account
from eigenfail_api.dashboard.views.analysis import analysis_view
from eigenfail_api.dashboard.views.clip import clip_view
from eigenfail_api.dashboard.views.episode import episode_view
from eigenfail_api.dashboard.views.region import region_to_come, region_view
from eigenfail_api.dashboard.views.repeated import Run, Verdict, source_of, verdict
from eigenfail_api.dashboard.views.replay import replay_view
from eigenfail_api.parameters import AnalysisId, CampaignId, EpisodeIndex, Stored
from eigenfail_api.routes.explanations import ASIDE, EXPLANATIONS
from eigenfail_api.routes.safety import REGIONS
from eigenfail_services.campaigns.crew import who_ran
from eigenfail_services.campaigns.proofs import proof
from eigenfail_services.campaigns.region import region_aside

router = APIRouter(include_in_schema=False, default_response_class=HTMLResponse)

LONGEST_S = 1e6
Moment = Annotated[float | None, Query(ge=0.0, le=LONGEST_S)]


@router.get("/campaigns/{campaign}/episodes/{index}")
def show_episode(
    store: Stored,
    campaign: CampaignId,
    index: EpisodeIndex,
    t: Moment = None,  # noqa: ARG001  # the player reads it from the address
) -> HTMLResponse:
    """One episode."""
    seen = store.campaigns.get(campaign)
    result = store.episodes.get(campaign, index)
    mission = mission_of(seen.spec, result.seed)
    following = next_failure(store, campaign, index)
    view = episode_view(seen, result, mission, following, judged(store, Run(seen, result)))
    return page("episode.html", view)


@router.get("/campaigns/{campaign}/episodes/{index}/account")
async def show_account(store: Stored, campaign: CampaignId, index: EpisodeIndex) -> HTMLResponse:
    """What the planner says of an episode: its page asks for it once it stands."""
    seen = await run_sync(store.campaigns.get, campaign)
    try:
        told = await ASIDE.do(EXPLANATIONS.of, store, campaign, index)
    except (NotFound, ServiceBusy):
        raise
    except EigenfailError as error:
        return page("account.html", no_account(campaign, seen.spec.name, index, error))
    stored = await run_sync(store.episodes.get, campaign, index)
    mission = await run_sync(mission_of, seen.spec, stored.seed)
    return page("account.html", account_view(campaign, seen.spec.name, index, told, mission))


@router.get("/campaigns/{campaign}/episodes/{index}/clip")
def show_clip(store: Stored, campaign: CampaignId, index: EpisodeIndex) -> HTMLResponse:
    """A small player of an episode: other pages ask for it when it is opened."""
    seen = store.campaigns.get(campaign)
    result = store.episodes.get(campaign, index)
    return page("clip.html", clip_view(seen, result, mission_of(seen.spec, result.seed)))


@router.get("/campaigns/{campaign}/region")
def show_region(store: Stored, campaign: CampaignId) -> HTMLResponse:
    """The page on which the failing region of a campaign appears."""
    return page("region.html", region_to_come(store.campaigns.get(campaign)))


@router.get("/campaigns/{campaign}/region/boxes")
async def show_boxes(store: Stored, campaign: CampaignId) -> HTMLResponse:
    """The failing region of a campaign: its page asks for it once it stands."""
    found = await REGIONS.do(region_aside, store, (campaign,))
    seen = await run_sync(store.campaigns.get, campaign)
    return page("region.html", region_view(seen, found))


@router.get("/replays/{campaign}")
def show_replay(store: Stored, campaign: CampaignId) -> HTMLResponse:
    """Where one waits for the only episode of a replay."""
    seen, result = store.campaigns.get(campaign), first(store, campaign)
    told = judged(store, Run(seen, result)) if result else None
    return page("replay.html", replay_view(seen, told, has_arrived=result is not None))


@router.get("/analyses/{analysis}")
def show_analysis(store: Stored, analysis: AnalysisId) -> HTMLResponse:
    """One analysis."""
    seen = store.analyses.get(analysis)
    proven = proof(store, seen) if seen.result else None
    return page("analysis.html", analysis_view(seen, store.campaigns.get(seen.campaign), proven))


def first(store: Store, campaign: int) -> EpisodeResult | None:
    """The first episode of a campaign, once it is in."""
    try:
        return store.episodes.get(campaign, 0)
    except NotFound:
        return None


def judged(store: Store, again: Run) -> Verdict | None:
    """Whether a replay gave the result that is stored; None if it repeats none that is kept."""
    source = source_of(again.campaign.spec, again.result.index)
    if source is None:
        return None
    campaign, index = source
    try:
        stored = store.episodes.finished(campaign, [index])
    except NoisePruned:
        return None
    if not stored:
        return None
    differing = versions_apart(store, source, (again.campaign.id, again.result.index))
    return verdict(Run(store.campaigns.get(campaign), stored[0]), again, differing)


def versions_apart(
    store: Store, first: tuple[int, int], second: tuple[int, int]
) -> tuple[str, ...]:
    """In which versions two episodes were run differently, where both are known."""
    try:
        then, now = (who_ran(store, *each).versions for each in (first, second))
    except NotFound:
        return ()
    return differences(then, now)


def next_failure(store: Store, campaign: int, index: int) -> int | None:
    """Index of the next collision of the campaign, if there is one."""
    following = store.episodes.page(campaign, 1, index, FAILURES).items
    return following[0].index if following else None


def mission_of(spec: CampaignSpec, seed: int) -> Mission | None:
    """Lanes and time step as the scenario tells them; None where it is not installed here."""
    try:
        plugin = plugins.load(plugins.SCENARIOS, spec.scenario)
        variation = read_variation(plugin.Parameters, spec.scenario_parameters)
        mission: Mission = plugin()(variation.draw(seed), seed).mission
    except EigenfailError:
        return None
    return mission
