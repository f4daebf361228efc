"""The page of an episode, and its neighbours in the list that it was reached from."""

from collections.abc import Sequence
from math import sqrt
from typing import Annotated, Any
from urllib.parse import urlencode

from anyio.to_thread import run_sync
from fastapi import APIRouter, Depends, Query
from fastapi.responses import HTMLResponse

from eigenfail.contracts.recording import list_formats
from eigenfail.errors import EigenfailError, NotFound, ServiceBusy
from eigenfail.filters import BY_INDEX, parse_filter, parse_sort, write_failure_filter
from eigenfail.presentation import episodes, figures
from eigenfail.values.campaign import Campaign, CampaignFilter
from eigenfail.values.disturbance import find_channel_likelihoods
from eigenfail.values.episode import EpisodeResult
from eigenfail.values.measures import MEASURES, Measure, Measures
from eigenfail.values.records import Assessment, assess
from eigenfail.values.scene import Mission
from eigenfail.wire.http import PREFIX
from eigenfail.worlds import drawn_for, placed_for, world_of
from eigenfail_api.dashboard import episodes_page, rendering
from eigenfail_api.dashboard.charts import make_reference
from eigenfail_api.dashboard.replay_page import Run, find_source, judge_replay
from eigenfail_api.dashboard.scene import (
    list_jumps,
    make_account_view,
    make_course_charts,
    make_noise_chart,
    make_scene_chart,
)
from eigenfail_api.parameters import CampaignId, EpisodeIndex, Stored
from eigenfail_api.routes.episodes import EXPLAINING, EXPLANATIONS
from eigenfail_services.campaigns.minimal_failures import METHOD as MINIMAL
from eigenfail_services.campaigns.recordings import find_mission
from eigenfail_services.store.store import Store

Facts = tuple[tuple[str, str], ...]

NOT_CLASSIFIED = "not classified"


def list_facts(
    result: EpisodeResult, channels: Sequence[str], dt_s: float | None, *, has_road: bool
) -> Facts:
    """Return the facts on an episode: its measures, likelihood, origin and computing time.

    For a function, only the robustness was measured. It does not have a unit.
    """
    measures, steps = result.measures, result.steps
    lasted = f" ({figures.format_number(steps * dt_s)} s)" if dt_s else ""
    assessed = assess(result.outcome, measures)
    robustness = figures.format_number(measures.robustness_m if measures else None)
    return (
        ("Steps", f"{steps}{lasted}"),
        *(list_danger(measures, assessed) if measures and has_road else ()),
        *([("Robustness", robustness)] if measures and not has_road else []),
        *list_likelihood(result, channels),
        ("Disturbance source", result.source),
        ("Seed", str(result.seed)),
        ("Computed in", figures.format_duration(result.wall_s)),
    )


def list_likelihood(result: EpisodeResult, channels: Sequence[str]) -> Facts:
    """Return log p of the noise, of each channel and of typical noise; nothing without a step."""
    # log p is compared with the log p of typical noise over the same steps.
    held_against = make_reference([result.noise])
    if held_against is None:
        return ()
    total, steps = result.noise.log_probability, result.steps
    typical, none = held_against.typical, held_against.none
    return (
        ("log p", f"{figures.format_number(total, 5)} nats"),
        ("log p per step", f"{figures.format_number(total / steps)} nats"),
        (
            "Typical log p per step",
            f"{figures.format_number(typical)} nats, {figures.format_number(none)} without noise",
        ),
        *episodes.list_channel_likelihoods(find_channel_likelihoods(result.noise, channels)),
    )


def list_danger(measures: Measures, assessed: Assessment) -> Facts:
    """Return the measures of how near the episode came to a collision."""
    # With several requirements, robustness is a multiple of their scales and has no unit.
    unit = "m" if measures.nearest_m is None else ""
    return (
        ("Class", assessed.words or NOT_CLASSIFIED),
        ("Robustness", figures.format_quantity(measures.robustness_m, unit)),
        ("Severity", format_severity(measures.severity)),
        *([("Cause", measures.cause)] if measures.cause else []),
    )


IN_OTHER_PLACES = frozenset(
    {
        "robustness_m",
        "severity",
        "min_ttc_s",
        "max_drac_mps2",
        "ttc_violated_s",
        "collided_s",
        "drac_violated_s",
        "drac_at_warning_mps2",
        "final_drac_mps2",
        "nearest_m",
        "violated",
    }
)
"""Measures that stand among the facts of the episode, its requirements, or the thresholds."""


def list_ride(result: EpisodeResult) -> Facts:
    """Return all further measures; nothing if none of them was measured."""
    found = [
        (measure, getattr(result.measures, name, None))
        for name, measure in MEASURES.items()
        if name not in IN_OTHER_PLACES and not measure.is_text
    ]
    if all(value is None for _, value in found):
        return ()
    return tuple(_format_measure(measure, value) for measure, value in found)


def _format_measure(measure: Measure, value: Any) -> tuple[str, str]:
    if measure.event:
        return measure.event.capitalize(), episodes.format_event(value)
    if measure.is_count:
        return measure.label.capitalize(), figures.format_count(value)
    return measure.label.capitalize(), figures.format_quantity(value, measure.unit)


def format_severity(value: float | None) -> str:
    """Return the severity and its square root, the relative speed, as text."""
    if value is None:
        return figures.UNKNOWN
    speed = figures.format_number(sqrt(value))
    return f"{figures.format_number(value)} m²/s² (relative speed {speed} m/s)"


def make_episode_view(
    campaign: Campaign, result: EpisodeResult, mission: Mission | None
) -> dict[str, object]:
    """Return what the page of an episode shows; the mission, if there is one, gives the lanes."""
    scene, measures = result.scene, result.measures
    dt_s = scene.dt_s if scene else mission.dt_s if mission else None
    world = world_of(campaign.spec.simulator)
    channels, has_road = world.channels(campaign.spec), world.has_road
    assessed = assess(result.outcome, measures)
    drawn = drawn_for(campaign.spec, result.seed) | placed_for(campaign.spec, result.noise)
    # Without steps there is no noise to replay and nothing to explain.
    has_steps = result.steps > 0
    return {
        "campaign": campaign,
        "result": result,
        "badge": rendering.make_outcome_badge(result.outcome, is_unresolved=assessed.unresolved),
        "facts": list_facts(result, channels, dt_s, has_road=has_road),
        "varied": tuple((name, str(value)) for name, value in drawn.items()),
        "ride": list_ride(result) if has_road else (),
        "requirements": tuple(episodes.list_judged(campaign.spec, result.requirements)),
        "thresholds": episodes.tabulate_thresholds(measures, assessed)
        if measures and has_road
        else None,
        "noise": make_noise_chart(result.noise, dt_s, channels) if has_steps else None,
        "scene": make_scene_chart(scene, mission, result.outcome) if scene else None,
        "courses": make_course_charts(scene) if scene else (),
        "why_no_scene": "" if scene else explain_missing_scene(campaign, result),
        "stage": "Scene from above" if has_road else "The noise",
        "has_account": has_steps and has_road,
        "recordings": list_recordings(campaign.id, result.index) if has_steps and has_road else (),
        "jumps": list_jumps(result),
        "replayed": find_source(campaign.spec, result.index),
    }


def list_recordings(campaign: int, index: int) -> tuple[tuple[str, str], ...]:
    """Return name and address of an episode in each format that can be written here."""
    address = f"{PREFIX}/campaigns/{campaign}/episodes/{index}/recording"
    forms = list_formats().items()
    return tuple((form.title, f"{address}?{urlencode({'format': name})}") for name, form in forms)


def explain_missing_scene(campaign: Campaign, result: EpisodeResult) -> str:
    """Return the reason why an episode lacks a scene to play."""
    if not result.steps:
        return "The episode ended before its first step: there is no scene."
    if not world_of(campaign.spec.simulator).has_road:
        return "The system under test is a function of the noise: it has no scene and no planner."
    every = campaign.spec.scene_every
    sample = "" if every == 1 else f" and every {figures.format_count(every)}th of the others"
    return (
        "The scene of this episode was not kept: campaigns keep those of all failures"
        f"{sample}. Its noise was, so that it can be run again."
    )


router = APIRouter(include_in_schema=False, default_response_class=HTMLResponse)

LONGEST_S = 1e6
Conditions = Annotated[str | None, Query(alias="filter")]
Moment = Annotated[float | None, Query(ge=0.0, le=LONGEST_S)]


def read_list(
    conditions: Conditions = None, sort: str = str(BY_INDEX)
) -> episodes_page.EpisodeRequest | None:
    """Return the list that an episode was reached from, as the address states it.

    Raises:
        UnknownName: the list cannot have this order.
    """
    return (
        None if conditions is None else episodes_page.EpisodeRequest(conditions, parse_sort(sort))
    )


Listed = Annotated[episodes_page.EpisodeRequest | None, Depends(read_list)]


@router.get("/campaigns/{campaign}/episodes/{index}")
def show_episode(
    store: Stored,
    campaign: CampaignId,
    index: EpisodeIndex,
    listed: Listed,
    t: Moment = None,  # noqa: ARG001  # the player reads it from the address
) -> HTMLResponse:
    """Show an episode, with its neighbours in the list that led to it."""
    seen = store.campaigns.get(campaign)
    result = store.episodes.get(campaign, index)
    mission = find_mission(seen.spec, result)
    modes, newest = store.analyses.find_modes(campaign, index), store.analyses.find_newest(campaign)
    # A failure of no mode may be newer than the analysis, or be left out of it.
    is_left_out = result.outcome.is_failure and newest not in {mode.analysis for mode in modes}
    return rendering.page(
        "episode.html",
        make_episode_view(seen, result, mission),
        neighbours=find_neighbours(store, seen, index, listed),
        shrunk_by=find_shrinking(store, campaign, index) if result.is_failure else None,
        verdict=judge_replay(store, Run(seen, result)),
        mode=modes[0] if modes else None,
        left_out_by=newest if is_left_out else None,
    )


@router.get("/campaigns/{campaign}/episodes/{index}/account")
async def show_account(store: Stored, campaign: CampaignId, index: EpisodeIndex) -> HTMLResponse:
    """Show the planner's account of an episode, which the episode's page loads later."""
    seen = await run_sync(store.campaigns.get, campaign)
    try:
        explanation = await EXPLAINING.do(EXPLANATIONS.of, store, campaign, index)
    # These are answers of their own; everything else is said on the page.
    except (NotFound, ServiceBusy):
        raise
    except EigenfailError as error:
        problem = f"{error.problem} {error.remedy}".strip()
        return rendering.page("account.html", None, campaign=seen, index=index, problem=problem)
    stored = await run_sync(store.episodes.get, campaign, index)
    mission = await run_sync(find_mission, seen.spec, stored)
    view = make_account_view(explanation, mission)
    return rendering.page("account.html", view, campaign=seen, index=index, problem="")


@router.get("/campaigns/{campaign}/episodes/{index}/clip")
def show_clip(store: Stored, campaign: CampaignId, index: EpisodeIndex) -> HTMLResponse:
    """Show a small player of an episode, which other pages load when a user opens it."""
    seen, result = store.campaigns.get(campaign), store.episodes.get(campaign, index)
    mission, name = find_mission(seen.spec, result), f"clip-{campaign}-{index}-scene"
    scene = result.scene and make_scene_chart(result.scene, mission, result.outcome, name)
    unresolved = assess(result.outcome, result.measures).unresolved
    outcome = rendering.make_outcome_badge(result.outcome, is_unresolved=unresolved)
    return rendering.page("clip.html", seen, index=index, outcome=outcome, scene=scene)


def find_shrinking(store: Store, campaign: int, index: int) -> int | None:
    """Return the newest campaign that shrinks an episode, by its name; None without one."""
    # The name narrows the search, and the settings decide: names may be edited.
    named = CampaignFilter(method=MINIMAL, search=f"minimal failure of {campaign}/{index}")
    wanted = {"campaign": campaign, "episode": index}
    found = store.campaigns.page(MOST_SHRINKING, where=named).items
    return next((each.id for each in found if each.spec.settings.items() >= wanted.items()), None)


MOST_SHRINKING = 10


def find_neighbours(
    store: Store, campaign: Campaign, index: int, listed: episodes_page.EpisodeRequest | None
) -> dict[str, object]:
    """Return the neighbours of an episode in the list that it was reached from.

    Raises:
        InvalidValue, UnknownName: the list cannot have this filter or order.
    """
    asked = listed or episodes_page.EpisodeRequest(write_failure_filter(campaign.spec), BY_INDEX)
    where, sort = parse_filter(asked.filter), asked.sort
    following = store.episodes.page(campaign.id, 1, index, where, sort).items

    def link(found: int) -> tuple[int, str]:
        return found, episodes_page.make_episode_address(campaign.id, found, listed)

    preceding = store.episodes.find_preceding(campaign.id, index, where, sort)
    address = ""
    if listed:
        address = episodes_page.make_address(campaign.id, listed.filter, str(listed.sort))
    return {
        "listed": address,
        # Who came from no list sees the failures in their order.
        "noun": "episode" if listed else "failure",
        "previous": None if preceding is None else link(preceding),
        "next": link(following[0].index) if following else None,
    }
