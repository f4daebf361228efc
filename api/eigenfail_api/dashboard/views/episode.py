"""One episode: facts, noise, and the scene from above."""

import msgspec

from eigenfail import functions
from eigenfail.values import Campaign, EpisodeResult, Mission
from eigenfail.variations import drawn_for
from eigenfail_api.dashboard import formats
from eigenfail_api.dashboard.views.charts import Chart
from eigenfail_api.dashboard.views.findings import Grid
from eigenfail_api.dashboard.views.measured import Facts, facts, ride, thresholds
from eigenfail_api.dashboard.views.moments import Jump, jumps
from eigenfail_api.dashboard.views.repeated import Verdict, source_of
from eigenfail_api.dashboard.views.scene import clearance_chart, noise_chart, scene_chart
from eigenfail_api.dashboard.views.states import OUTCOME_BADGES, Badge


class EpisodeView(msgspec.Struct, frozen=True, kw_only=True):
    """The page of an episode.

    Attributes:
        facts: what the episode was.
        varied: the scenario parameters that it drew; empty where they are fixed.
        ride: how rough it was; empty if not measured.
        thresholds: the safety measures; None if not measured.
        why_no_scene: empty if there is one.
        stage: what the first part shows, as its title.
        can_replay: whether there is noise that could be injected again.
        jumps: moments that were measured.
        next_failure: index of the next collision of the campaign, if there is one.
        replayed: campaign and index of the episode whose noise it repeats; None if of no episode.
        verdict: whether it is the same again; None if it repeats no episode that is known.
    """

    campaign: int
    campaign_name: str
    index: int
    badge: Badge
    facts: Facts
    varied: Facts
    ride: Facts
    thresholds: Grid | None
    problem: str
    digest: str
    noise: Chart | None
    scene: Chart | None
    clearance: Chart | None
    why_no_scene: str
    stage: str
    can_replay: bool
    has_account: bool
    jumps: tuple[Jump, ...]
    next_failure: int | None
    replayed: tuple[int, int] | None
    verdict: Verdict | None


def episode_view(
    campaign: Campaign,
    result: EpisodeResult,
    mission: Mission | None,
    next_failure: int | None,
    verdict: Verdict | None,
) -> EpisodeView:
    """The page of an episode; the mission, where the scenario could tell it, gives the lanes."""
    fault, scene = result.fault, result.scene
    dt_s = scene.dt_s if scene else mission.dt_s if mission else None
    return EpisodeView(
        campaign=campaign.id,
        campaign_name=campaign.spec.name,
        index=result.index,
        badge=OUTCOME_BADGES[result.outcome],
        facts=facts(result, dt_s),
        varied=varied(campaign, result),
        ride=ride(result),
        thresholds=thresholds(result),
        problem=f"{fault.kind}: {fault.message}" if fault else "",
        digest=result.digest(),
        noise=noise_chart(result.noise, dt_s) if result.steps else None,
        scene=scene_chart(scene, mission, result.outcome) if scene else None,
        clearance=clearance_chart(scene) if scene else None,
        why_no_scene="" if scene else why_no_scene(campaign, result),
        stage="The noise" if is_function(campaign) else "Scene from above",
        can_replay=result.steps > 0,
        has_account=result.steps > 0 and not is_function(campaign),
        jumps=jumps(result),
        next_failure=next_failure,
        replayed=source_of(campaign.spec, result.index),
        verdict=verdict,
    )


def why_no_scene(campaign: Campaign, result: EpisodeResult) -> str:
    """Why there is nothing to play."""
    if not result.steps:
        return "The episode ended before its first step: there is nothing to play."
    if is_function(campaign):
        return "A function of the noise is under test: there is no scene, and no planner to ask."
    every = campaign.spec.scene_every
    sample = "" if every == 1 else f" and every {formats.integer(every)}th of the others"
    return (
        "The scene of this episode was not kept: campaigns keep those of all collisions"
        f"{sample}. Its noise was, so that it can be run again."
    )


def is_function(campaign: Campaign) -> bool:
    """Whether a function is under test, in place of a planner on a road."""
    return campaign.spec.simulator == functions.SIMULATOR


def varied(campaign: Campaign, result: EpisodeResult) -> Facts:
    """The scenario parameters that the episode drew from its own seed."""
    drawn = drawn_for(campaign.spec, result.seed)
    return tuple((name, str(value)) for name, value in drawn.items())
