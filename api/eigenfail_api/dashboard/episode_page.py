"""The page of an episode, and its neighbours in the list that it was reached from."""

from collections.abc import Sequence
from math import sqrt
from typing import Annotated, Any, NamedTuple
from urllib.parse import urlencode

import msgspec
from anyio.to_thread import run_sync
from fastapi import APIRouter, Depends, Query
from fastapi.responses import HTMLResponse

from eigenfail import values
from eigenfail.contracts.recording import list_formats
from eigenfail.errors import EigenfailError, NotFound, ServiceBusy
from eigenfail.filters import BY_INDEX, parse_filter, parse_sort, write_failure_filter
from eigenfail.presentation import episodes, figures
from eigenfail.presentation.tables import Table
from eigenfail.values.campaign import CampaignFilter
from eigenfail.values.disturbance import find_channel_likelihoods
from eigenfail.wire.http import PREFIX
from eigenfail.worlds import drawn_for, placed_for, world_of
from eigenfail_api.dashboard import episodes_page, rendering
from eigenfail_api.dashboard.charts import Chart, make_reference
from eigenfail_api.dashboard.replay_page import ReplayVerdict, Run, find_source, judge_replay
from eigenfail_api.dashboard.scene import (
    Jump,
    list_jumps,
    make_account_view,
    make_clip_view,
    make_course_charts,
    make_missing_account_view,
    make_noise_chart,
    make_scene_chart,
)
from eigenfail_api.parameters import CampaignId, EpisodeIndex, Stored
from eigenfail_api.routes.episodes import EXPLAINING, EXPLANATIONS
from eigenfail_services.campaigns.minimal_failures import METHOD as MINIMAL
from eigenfail_services.campaigns.recordings import find_mission
from eigenfail_services.store import Store

Facts = tuple[tuple[str, str], ...]

NOT_CLASSIFIED = "not classified"


def list_facts(
    result: values.EpisodeResult, channels: Sequence[str], dt_s: float | None, *, has_road: bool
) -> Facts:
    """Return the facts on an episode: its outcome, origin and versions.

    Of a function robustness alone was measured, which has no unit.
    """
    measures, steps = result.measures, result.steps
    lasted = f" ({figures.format_number(steps * dt_s)} s)" if dt_s else ""
    assessed = values.assess(result.outcome, measures)
    return (
        ("Steps", f"{steps}{lasted}"),
        *(list_danger(measures, assessed) if measures and has_road else ()),
        *(
            [("Robustness", figures.format_number(measures.robustness_m))]
            if measures and not has_road
            else []
        ),
        *list_likelihood(result, channels),
        ("Disturbance source", result.source),
        ("Seed", str(result.seed)),
        ("Computed in", figures.format_duration(result.wall_s)),
    )


def list_likelihood(result: values.EpisodeResult, channels: Sequence[str]) -> Facts:
    """Return log p of the noise, of each channel and of typical noise; nothing without a step."""
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


def list_danger(measures: values.Measures, assessed: values.Assessment) -> Facts:
    """Return the measures of how near the episode came to a collision."""
    return (
        ("Class", assessed.words or NOT_CLASSIFIED),
        (
            "Robustness",
            figures.format_quantity(
                measures.robustness_m, "m" if measures.nearest_m is None else ""
            ),
        ),
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


def list_ride(result: values.EpisodeResult) -> Facts:
    """Return all further measures; none where the release that ran the episode had none of them."""
    measures = result.measures
    if measures is None or measures.clipped_steps is None:
        return ()
    return tuple(
        _format_measure(measure, getattr(measures, name))
        for name, measure in values.MEASURES.items()
        if name not in IN_OTHER_PLACES and not measure.is_text
    )


def _format_measure(measure: values.Measure, value: Any) -> tuple[str, str]:
    if measure.event:
        return measure.event.capitalize(), episodes.format_event(value)
    if measure.is_count:
        return measure.label.capitalize(), figures.format_count(value)
    return measure.label.capitalize(), figures.format_quantity(value, measure.unit)


def format_severity(value: float | None) -> str:
    """Return severity and the relative speed of which it is the square, as text."""
    if value is None:
        return figures.UNKNOWN
    speed = figures.format_number(sqrt(value))
    return f"{figures.format_number(value)} m²/s² (relative speed {speed} m/s)"


class Neighbours(msgspec.Struct, frozen=True):
    """The episodes before and after one in a list.

    Attributes:
        listed: address of the list; None for the failures by number, which an episode is shown with
            that was reached from no list.
        noun: what the list is of, as text.
        previous: index and address of the one before it; None for the first.
        next: index and address of the one after it; None for the last.
    """

    listed: str | None
    noun: str
    previous: tuple[int, str] | None
    next: tuple[int, str] | None


class EpisodeView(msgspec.Struct, frozen=True, kw_only=True):
    """The page of an episode.

    Attributes:
        facts: what the episode was.
        varied: the scenario parameters that it drew; empty where they are fixed.
        ride: how rough it was; empty if not measured.
        requirements: robustness of each requirement that the campaign names.
        thresholds: the safety measures; None if not measured, and of a function.
        why_no_scene: empty if there is one.
        stage: what the first part shows, as its title.
        can_replay: whether there is noise that could be injected again.
        is_failure: whether it violated a requirement, so that it can be shrunk.
        shrunk_by: the newest campaign that has shrunk it; None without one.
        recordings: name and address of the episode as a file of each format for other tools.
        jumps: moments that were measured.
        neighbours: the episodes before and after it in a list.
        replayed: campaign and index of the episode whose noise it repeats; None if of no episode.
        verdict: whether it is the same again; None if it repeats no episode that is known.
        mode: its failure mode in the newest analysis of it; None if it was not analysed.
        left_out_by: the newest analysis of its campaign, if that left this failure out.
    """

    campaign: int
    campaign_name: str
    index: int
    badge: rendering.Badge
    facts: Facts
    varied: Facts
    ride: Facts
    requirements: Facts
    thresholds: Table | None
    problem: str
    digest: str
    noise: Chart | None
    scene: Chart | None
    courses: tuple[Chart, ...]
    why_no_scene: str
    stage: str
    can_replay: bool
    is_failure: bool
    shrunk_by: int | None
    has_account: bool
    recordings: tuple[tuple[str, str], ...]
    jumps: tuple[Jump, ...]
    neighbours: Neighbours
    replayed: tuple[int, int] | None
    verdict: ReplayVerdict | None
    mode: values.Mode | None
    left_out_by: int | None


class EpisodeContext(NamedTuple):
    """What other results say of an episode; the fields are those of its page."""

    neighbours: Neighbours
    shrunk_by: int | None
    verdict: ReplayVerdict | None
    mode: values.Mode | None
    left_out_by: int | None


def make_episode_view(
    campaign: values.Campaign,
    result: values.EpisodeResult,
    mission: values.Mission | None,
    context: EpisodeContext,
) -> EpisodeView:
    """Return the page of an episode; the mission, where the scenario has one, gives the lanes."""
    fault, scene, measures = result.fault, result.scene, result.measures
    dt_s = scene.dt_s if scene else mission.dt_s if mission else None
    world = world_of(campaign.spec.simulator)
    channels, has_road = world.channels(campaign.spec), world.has_road
    return EpisodeView(
        campaign=campaign.id,
        campaign_name=campaign.spec.name,
        index=result.index,
        badge=rendering.make_outcome_badge(
            result.outcome, is_unresolved=values.assess(result.outcome, measures).unresolved
        ),
        facts=list_facts(result, channels, dt_s, has_road=has_road),
        varied=list_drawn_parameters(campaign, result),
        ride=list_ride(result) if has_road else (),
        requirements=tuple(episodes.list_judged(campaign.spec, result.requirements)),
        thresholds=episodes.tabulate_thresholds(measures, values.assess(result.outcome, measures))
        if measures and has_road
        else None,
        problem=f"{fault.kind}: {fault.message}" if fault else "",
        digest=result.digest(),
        noise=make_noise_chart(result.noise, dt_s, channels) if result.steps else None,
        scene=make_scene_chart(scene, mission, result.outcome) if scene else None,
        courses=make_course_charts(scene) if scene else (),
        why_no_scene="" if scene else explain_missing_scene(campaign, result),
        stage="Scene from above" if has_road else "The noise",
        can_replay=result.steps > 0,
        is_failure=result.is_failure,
        has_account=result.steps > 0 and has_road,
        recordings=list_recordings(campaign.id, result.index)
        if result.steps > 0 and has_road
        else (),
        jumps=list_jumps(result),
        replayed=find_source(campaign.spec, result.index),
        **context._asdict(),
    )


def list_recordings(campaign: int, index: int) -> tuple[tuple[str, str], ...]:
    """Return name and address of an episode in each format that can be written here."""
    address = f"{PREFIX}/campaigns/{campaign}/episodes/{index}/recording"
    forms = list_formats().items()
    return tuple((form.title, f"{address}?{urlencode({'format': name})}") for name, form in forms)


def explain_missing_scene(campaign: values.Campaign, result: values.EpisodeResult) -> str:
    """Return the reason why there is no scene to play."""
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


def list_drawn_parameters(campaign: values.Campaign, result: values.EpisodeResult) -> Facts:
    """The scenario parameters that the episode drew from its own seed, or that its noise chose."""
    spec = campaign.spec
    drawn = drawn_for(spec, result.seed) | placed_for(spec, result.noise)
    return tuple((name, str(value)) for name, value in drawn.items())


router = APIRouter(include_in_schema=False, default_response_class=HTMLResponse)

LONGEST_S = 1e6
Conditions = Annotated[str | None, Query(alias="filter")]
Moment = Annotated[float | None, Query(ge=0.0, le=LONGEST_S)]


def read_list(
    conditions: Conditions = None, sort: str = str(BY_INDEX)
) -> episodes_page.EpisodeRequest | None:
    """Return the list that an episode was reached from, as its address has it.

    Raises:
        UnknownName: the list has no such order.
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
    """One episode, and its neighbours in the list that it was reached from."""
    seen = store.campaigns.get(campaign)
    result = store.episodes.get(campaign, index)
    mission = find_mission(seen.spec, result)
    modes, newest = store.analyses.find_modes(campaign, index), store.analyses.find_newest(campaign)
    is_left_out = result.outcome.is_failure and newest not in {mode.analysis for mode in modes}
    context = EpisodeContext(
        find_neighbours(store, seen, index, listed),
        find_shrinking(store, campaign, index) if result.is_failure else None,
        judge_replay(store, Run(seen, result)),
        modes[0] if modes else None,
        newest if is_left_out else None,
    )
    return rendering.page("episode.html", make_episode_view(seen, result, mission, context))


@router.get("/campaigns/{campaign}/episodes/{index}/account")
async def show_account(store: Stored, campaign: CampaignId, index: EpisodeIndex) -> HTMLResponse:
    """What the planner says of an episode: its page asks for it once it stands."""
    seen = await run_sync(store.campaigns.get, campaign)
    try:
        explanation = await EXPLAINING.do(EXPLANATIONS.of, store, campaign, index)
    except (NotFound, ServiceBusy):
        raise
    except EigenfailError as error:
        return rendering.page(
            "account.html", make_missing_account_view(campaign, seen.spec.name, index, error)
        )
    stored = await run_sync(store.episodes.get, campaign, index)
    mission = await run_sync(find_mission, seen.spec, stored)
    return rendering.page(
        "account.html", make_account_view(campaign, seen.spec.name, index, explanation, mission)
    )


@router.get("/campaigns/{campaign}/episodes/{index}/clip")
def show_clip(store: Stored, campaign: CampaignId, index: EpisodeIndex) -> HTMLResponse:
    """A small player of an episode: other pages ask for it when it is opened."""
    seen = store.campaigns.get(campaign)
    result = store.episodes.get(campaign, index)
    return rendering.page(
        "clip.html", make_clip_view(seen, result, find_mission(seen.spec, result))
    )


def find_shrinking(store: Store, campaign: int, index: int) -> int | None:
    """Return the newest campaign that shrinks an episode, by its name; None without one."""
    named = CampaignFilter(method=MINIMAL, search=f"minimal failure of {campaign}/{index}")
    wanted = {"campaign": campaign, "episode": index}
    found = store.campaigns.page(MOST_SHRINKING, where=named).items
    return next((each.id for each in found if each.spec.settings.items() >= wanted.items()), None)


MOST_SHRINKING = 10


def find_neighbours(
    store: Store, campaign: values.Campaign, index: int, listed: episodes_page.EpisodeRequest | None
) -> Neighbours:
    """Return the neighbours of an episode in the list that it was reached from.

    Raises:
        InvalidValue, UnknownName: the list has no such filter or order.
    """
    asked = listed or episodes_page.EpisodeRequest(write_failure_filter(campaign.spec), BY_INDEX)
    where, sort = parse_filter(asked.filter), asked.sort
    following = store.episodes.page(campaign.id, 1, index, where, sort).items

    def link(found: int) -> tuple[int, str]:
        return found, episodes_page.make_episode_address(campaign.id, found, listed)

    preceding = store.episodes.find_preceding(campaign.id, index, where, sort)
    return Neighbours(
        episodes_page.make_address(campaign.id, listed.filter, str(listed.sort))
        if listed
        else None,
        "episode" if listed else "failure",
        None if preceding is None else link(preceding),
        link(following[0].index) if following else None,
    )
