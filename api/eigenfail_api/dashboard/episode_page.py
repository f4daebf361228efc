"""The page of an episode, and that of a replay whose episode is still to come."""

from collections.abc import Iterator, Sequence
from math import sqrt
from typing import Annotated, Any, NamedTuple

import msgspec
from anyio.to_thread import run_sync
from fastapi import APIRouter, Query
from fastapi.responses import HTMLResponse

from eigenfail.errors import EigenfailError, NoisePruned, NotFound, ServiceBusy
from eigenfail.exchange import list_formats
from eigenfail.exchange.recording import RecordingFormat
from eigenfail.filters import parse_filter, write_failure_filter
from eigenfail.presentation.episodes import (
    format_event,
    list_channel_likelihoods,
    list_judged,
    tabulate_thresholds,
)
from eigenfail.presentation.figures import (
    UNKNOWN,
    count_noun,
    format_count,
    format_duration,
    format_number,
    format_quantity,
)
from eigenfail.presentation.tables import Table
from eigenfail.values import (
    FINAL_STATES,
    MEASURES,
    Assessment,
    Campaign,
    CampaignSpec,
    EpisodeResult,
    Measure,
    Measures,
    Mission,
    Mode,
    assess,
)
from eigenfail.values.disturbance import find_channel_likelihoods
from eigenfail.versions import differences
from eigenfail.wire.http import PREFIX
from eigenfail.worlds import drawn_for, placed_for, world_of
from eigenfail_api.dashboard.charts import Chart, make_reference
from eigenfail_api.dashboard.cost_charts import REPLAY
from eigenfail_api.dashboard.rendering import (
    OUTCOME_BADGES,
    Badge,
    make_campaign_badge,
    make_outcome_badge,
    page,
)
from eigenfail_api.dashboard.scene import (
    Jump,
    list_jumps,
    make_account_view,
    make_clearance_chart,
    make_clip_view,
    make_missing_account_view,
    make_noise_chart,
    make_scene_chart,
)
from eigenfail_api.dashboard.triage_forms import TriageView, make_triage_view
from eigenfail_api.parameters import CampaignId, EpisodeIndex, Stored
from eigenfail_api.routes.episodes import EXPLAINING, EXPLANATIONS
from eigenfail_services.campaigns.recordings import find_mission
from eigenfail_services.campaigns.summary import find_worker
from eigenfail_services.store import Store
from eigenfail_services.store.triage import episode_subject

Facts = tuple[tuple[str, str], ...]

NOT_CLASSIFIED = "not classified"


def list_facts(
    result: EpisodeResult, channels: Sequence[str], dt_s: float | None, *, has_road: bool
) -> Facts:
    """Return the facts on an episode: its outcome, origin and versions.

    Of a function robustness alone was measured, which has no unit.
    """
    measures, steps = result.measures, result.steps
    lasted = f" ({format_number(steps * dt_s)} s)" if dt_s else ""
    assessed = assess(result.outcome, measures)
    return (
        ("Steps", f"{steps}{lasted}"),
        *(list_danger(measures, assessed) if measures and has_road else ()),
        *(
            [("Robustness", format_number(measures.robustness_m))]
            if measures and not has_road
            else []
        ),
        *list_likelihood(result, channels),
        ("Disturbance source", result.source),
        ("Seed", str(result.seed)),
        ("Computed in", format_duration(result.wall_s)),
    )


def list_likelihood(result: EpisodeResult, channels: Sequence[str]) -> Facts:
    """Return log p of the noise, of each channel and of typical noise; nothing without a step."""
    held_against = make_reference([result.noise])
    if held_against is None:
        return ()
    total, steps = result.noise.log_probability, result.steps
    typical, none = held_against.typical, held_against.none
    return (
        ("log p", f"{format_number(total, 5)} nats"),
        ("log p per step", f"{format_number(total / steps)} nats"),
        (
            "Typical log p per step",
            f"{format_number(typical)} nats, {format_number(none)} without noise",
        ),
        *list_channel_likelihoods(find_channel_likelihoods(result.noise, channels)),
    )


def list_danger(measures: Measures, assessed: Assessment) -> Facts:
    """Return the measures of how near the episode came to a collision."""
    return (
        ("Class", assessed.words or NOT_CLASSIFIED),
        (
            "Robustness",
            format_quantity(measures.robustness_m, "m" if measures.nearest_m is None else ""),
        ),
        ("Severity", format_severity(measures.severity)),
        *([("Cause", measures.cause)] if measures.cause else []),
    )


IN_OTHER_PLACES = frozenset(
    {
        *("robustness_m", "severity", "min_ttc_s", "max_drac_mps2", "ttc_violated_s", "collided_s"),
        *("drac_violated_s", "drac_at_warning_mps2", "final_drac_mps2", "nearest_m", "violated"),
    }
)
"""Measures that stand among the facts of the episode, its requirements, or the thresholds."""


def list_ride(result: EpisodeResult) -> Facts:
    """Return all further measures; none where the release that ran the episode had none of them."""
    measures = result.measures
    if measures is None or measures.clipped_steps is None:
        return ()
    return tuple(
        _format_measure(measure, getattr(measures, name))
        for name, measure in MEASURES.items()
        if name not in IN_OTHER_PLACES and not measure.is_text
    )


def _format_measure(measure: Measure, value: Any) -> tuple[str, str]:
    if measure.event:
        return measure.event.capitalize(), format_event(value)
    if measure.is_count:
        return measure.label.capitalize(), format_count(value)
    return measure.label.capitalize(), format_quantity(value, measure.unit)


def format_severity(value: float | None) -> str:
    """Return severity and the relative speed of which it is the square, as text."""
    if value is None:
        return UNKNOWN
    return f"{format_number(value)} m²/s² (relative speed {format_number(sqrt(value))} m/s)"


SAME = "Same result, bit for bit."
OTHER = "Different result."
REPEATABLE = (
    "The digest is that of the stored episode: what happened follows from the noise, and can be "
    "shown again."
)
NOT_REPEATABLE = (
    "Nothing was changed, so the result should be the same: planner, simulator or machine is not "
    "deterministic, or their versions differ. Use those that the campaign ran on."
)
WORLD = ("planner", "planner_settings", "scenario", "simulator", "disturbance", "requirements")


class Run(NamedTuple):
    """An episode and its campaign."""

    campaign: Campaign
    result: EpisodeResult


class ReplayVerdict(msgspec.Struct, frozen=True, kw_only=True):
    """Whether it is the same.

    Attributes:
        meaning: what follows from that.
        tone: of a good thing, of a doubtful one, or of neither: empty.
    """

    words: str
    meaning: str
    tone: str
    sign: str


def find_source(spec: CampaignSpec, index: int) -> tuple[int, int] | None:
    """Return campaign and index of the episode whose noise is repeated; None if of no episode."""
    campaign, episodes = (spec.settings.get(name) for name in ("campaign", "episodes"))
    if spec.method != REPLAY or not campaign or not episodes:
        return None
    return campaign, episodes[index % len(episodes)]


def make_replay_verdict(stored: Run, again: Run, differing: Sequence[str] = ()) -> ReplayVerdict:
    """Compare two results by their digests; `differing` lists the versions that differ."""
    if stored.result.digest() == again.result.digest():
        return ReplayVerdict(words=SAME, meaning=REPEATABLE, tone="is-distinct", sign="✓")
    courses = (
        f"Stored: {describe_course(stored.result)}; replayed: {describe_course(again.result)}."
    )
    changes = [*list_changes(stored, again), *(f"other versions ({each})" for each in differing)]
    if not changes:
        meaning = f"{courses} {NOT_REPEATABLE}"
        return ReplayVerdict(words=OTHER, meaning=meaning, tone="is-doubtful", sign="!")
    why = f"The result may differ, with {' and '.join(changes)}."
    return ReplayVerdict(words=OTHER, meaning=f"{courses} {why}", tone="", sign="≠")


def describe_course(result: EpisodeResult) -> str:
    """Return the outcome and the number of steps, as text."""
    after = count_noun(result.steps, "step")
    return f"{OUTCOME_BADGES[result.outcome].word} after {after}"


def list_changes(stored: Run, again: Run) -> Iterator[str]:
    """In what the replay differs from a plain one."""
    scale = again.campaign.spec.settings.get("scale", 1.0)
    if scale != 1.0:
        yield f"noise × {scale:g}"
    before, now = stored.campaign.spec, again.campaign.spec
    for name in WORLD:
        if getattr(before, name) != getattr(now, name):
            yield f"another {name.replace('_', ' ').replace('settings', 'setting')}"
    if draw_parameters(stored) != draw_parameters(again):
        yield "other scenario parameters"


def draw_parameters(run: Run) -> dict[str, Any]:
    """Return the scenario parameters that the episode drew."""
    spec = run.campaign.spec
    drawn, placed = drawn_for(spec, run.result.seed), placed_for(spec, run.result.noise)
    return {**spec.scenario_parameters, **drawn, **placed}


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
        recordings: name and address of the episode as a file of each format for other tools.
        jumps: moments that were measured.
        next_failure: index of the next failure of the campaign, if there is one.
        replayed: campaign and index of the episode whose noise it repeats; None if of no episode.
        verdict: whether it is the same again; None if it repeats no episode that is known.
        mode: its failure mode in the newest analysis of it; None if it was not analysed.
        left_out_by: the newest analysis of its campaign, if that left this failure out.
        triage: its state, owner, labels, ticket and notes.
    """

    campaign: int
    campaign_name: str
    index: int
    badge: Badge
    facts: Facts
    varied: Facts
    ride: Facts
    requirements: Facts
    thresholds: Table | None
    problem: str
    digest: str
    noise: Chart | None
    scene: Chart | None
    clearance: Chart | None
    why_no_scene: str
    stage: str
    can_replay: bool
    has_account: bool
    recordings: tuple[tuple[str, str], ...]
    jumps: tuple[Jump, ...]
    next_failure: int | None
    replayed: tuple[int, int] | None
    verdict: ReplayVerdict | None
    mode: Mode | None
    left_out_by: int | None
    triage: TriageView


class EpisodeContext(NamedTuple):
    """What other results say of an episode; the fields are those of its page."""

    next_failure: int | None
    verdict: ReplayVerdict | None
    mode: Mode | None
    left_out_by: int | None
    triage: TriageView


def make_episode_view(
    campaign: Campaign, result: EpisodeResult, mission: Mission | None, context: EpisodeContext
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
        badge=make_outcome_badge(
            result.outcome, is_unresolved=assess(result.outcome, measures).unresolved
        ),
        facts=list_facts(result, channels, dt_s, has_road=has_road),
        varied=list_drawn_parameters(campaign, result),
        ride=list_ride(result) if has_road else (),
        requirements=tuple(list_judged(campaign.spec, result.requirements)),
        thresholds=tabulate_thresholds(measures, assess(result.outcome, measures))
        if measures and has_road
        else None,
        problem=f"{fault.kind}: {fault.message}" if fault else "",
        digest=result.digest(),
        noise=make_noise_chart(result.noise, dt_s, channels) if result.steps else None,
        scene=make_scene_chart(scene, mission, result.outcome) if scene else None,
        clearance=make_clearance_chart(scene) if scene else None,
        why_no_scene="" if scene else explain_missing_scene(campaign, result),
        stage="Scene from above" if has_road else "The noise",
        can_replay=result.steps > 0,
        has_account=result.steps > 0 and has_road,
        recordings=list_recordings(campaign.id, result.index)
        if result.steps > 0 and has_road
        else (),
        jumps=list_jumps(result),
        replayed=find_source(campaign.spec, result.index),
        **context._asdict(),
    )


RECORDING_NAMES = {
    RecordingFormat.OPENSCENARIO: "OpenSCENARIO",
    RecordingFormat.MCAP: "MCAP",
    RecordingFormat.GIF: "GIF",
}


def list_recordings(campaign: int, index: int) -> tuple[tuple[str, str], ...]:
    """Return name and address of an episode in each format that can be written here."""
    address = f"{PREFIX}/campaigns/{campaign}/episodes/{index}/recording"
    return tuple((RECORDING_NAMES[form], f"{address}?format={form}") for form in list_formats())


def explain_missing_scene(campaign: Campaign, result: EpisodeResult) -> str:
    """Return the reason why there is no scene to play."""
    if not result.steps:
        return "The episode ended before its first step: there is no scene."
    if not world_of(campaign.spec.simulator).has_road:
        return "The system under test is a function of the noise: it has no scene and no planner."
    every = campaign.spec.scene_every
    sample = "" if every == 1 else f" and every {format_count(every)}th of the others"
    return (
        "The scene of this episode was not kept: campaigns keep those of all failures"
        f"{sample}. Its noise was, so that it can be run again."
    )


def list_drawn_parameters(campaign: Campaign, result: EpisodeResult) -> Facts:
    """The scenario parameters that the episode drew from its own seed, or that its noise chose."""
    spec = campaign.spec
    drawn = drawn_for(spec, result.seed) | placed_for(spec, result.noise)
    return tuple((name, str(value)) for name, value in drawn.items())


class ReplayView(msgspec.Struct, frozen=True, kw_only=True):
    """Where it stands.

    Attributes:
        has_arrived: whether its episode can be looked at.
        verdict: whether it is the same again, once it is in.
        is_open: whether it may still arrive.
    """

    campaign: int
    campaign_name: str
    badge: Badge
    has_arrived: bool
    is_open: bool
    because: str
    verdict: ReplayVerdict | None


def replay_view(
    campaign: Campaign, verdict: ReplayVerdict | None, *, has_arrived: bool
) -> ReplayView:
    """How a replay stands."""
    return ReplayView(
        campaign=campaign.id,
        campaign_name=campaign.spec.name,
        badge=make_campaign_badge(campaign.state, campaign.counts),
        has_arrived=has_arrived,
        is_open=not has_arrived and campaign.state not in FINAL_STATES,
        because=campaign.stopped_because,
        verdict=verdict,
    )


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
    mission = find_mission(seen.spec, result)
    following = find_next_failure(store, seen, index)
    modes, newest = store.analyses.find_modes(campaign, index), store.analyses.find_newest(campaign)
    is_left_out = result.outcome.is_failure and newest not in {mode.analysis for mode in modes}
    context = EpisodeContext(
        following,
        judge_replay(store, Run(seen, result)),
        modes[0] if modes else None,
        newest if is_left_out else None,
        make_triage_view(store, episode_subject(campaign, index)),
    )
    return page("episode.html", make_episode_view(seen, result, mission, context))


@router.get("/campaigns/{campaign}/episodes/{index}/account")
async def show_account(store: Stored, campaign: CampaignId, index: EpisodeIndex) -> HTMLResponse:
    """What the planner says of an episode: its page asks for it once it stands."""
    seen = await run_sync(store.campaigns.get, campaign)
    try:
        explanation = await EXPLAINING.do(EXPLANATIONS.of, store, campaign, index)
    except (NotFound, ServiceBusy):
        raise
    except EigenfailError as error:
        return page(
            "account.html", make_missing_account_view(campaign, seen.spec.name, index, error)
        )
    stored = await run_sync(store.episodes.get, campaign, index)
    mission = await run_sync(find_mission, seen.spec, stored)
    return page(
        "account.html", make_account_view(campaign, seen.spec.name, index, explanation, mission)
    )


@router.get("/campaigns/{campaign}/episodes/{index}/clip")
def show_clip(store: Stored, campaign: CampaignId, index: EpisodeIndex) -> HTMLResponse:
    """A small player of an episode: other pages ask for it when it is opened."""
    seen = store.campaigns.get(campaign)
    result = store.episodes.get(campaign, index)
    return page("clip.html", make_clip_view(seen, result, find_mission(seen.spec, result)))


@router.get("/replays/{campaign}")
def show_replay(store: Stored, campaign: CampaignId) -> HTMLResponse:
    """Where one waits for the only episode of a replay."""
    seen, result = store.campaigns.get(campaign), find_first_result(store, campaign)
    judged = judge_replay(store, Run(seen, result)) if result else None
    return page("replay.html", replay_view(seen, judged, has_arrived=result is not None))


def find_first_result(store: Store, campaign: int) -> EpisodeResult | None:
    """Return the first episode of a campaign; None before it has ended."""
    try:
        return store.episodes.get(campaign, 0)
    except NotFound:
        return None


def judge_replay(store: Store, again: Run) -> ReplayVerdict | None:
    """Whether a replay gave the result that is stored; None if it repeats none that is kept."""
    source = find_source(again.campaign.spec, again.result.index)
    if source is None:
        return None
    campaign, index = source
    try:
        stored = store.episodes.finished(campaign, [index])
    except NoisePruned:
        return None
    if not stored:
        return None
    differing = list_differing_versions(store, source, (again.campaign.id, again.result.index))
    return make_replay_verdict(Run(store.campaigns.get(campaign), stored[0]), again, differing)


def list_differing_versions(
    store: Store, first: tuple[int, int], second: tuple[int, int]
) -> tuple[str, ...]:
    """Return the versions that differ between two episodes, where both are known."""
    try:
        then, now = (find_worker(store, *each).versions for each in (first, second))
    except NotFound:
        return ()
    return differences(then, now)


def find_next_failure(store: Store, campaign: Campaign, index: int) -> int | None:
    """Return the index of the campaign's next failure; None if there is none."""
    wanted = parse_filter(write_failure_filter(campaign.spec))
    following = store.episodes.page(campaign.id, 1, index, wanted).items
    return following[0].index if following else None
