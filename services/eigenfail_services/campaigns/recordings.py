"""Stored episodes as recordings, with the roads of their scenarios, and files of them."""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from eigenfail import plugins
from eigenfail.contracts.recording import (
    EgoControl,
    EpisodeRecording,
    OverlaidRecordings,
    RecordingFormat,
    check_format,
    find_format,
    list_frame_steps,
)
from eigenfail.errors import Conflict, EigenfailError, InvalidValue
from eigenfail.values.analysis import Analysis
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.episode import EpisodeResult, Outcome
from eigenfail.values.scene import Mission, Scene
from eigenfail.values.variation import read_variation
from eigenfail.worlds import drawn_for, list_channels, placed_for, world_of
from eigenfail_services.campaigns.explanations import Explanations
from eigenfail_services.campaigns.proofs import read_result
from eigenfail_services.store.errors import make_mode_error
from eigenfail_services.store.store import Store

MAX_POSES = 200_000
"""Vehicles times steps of an episode that is written: a file is made in memory as a whole."""


MAX_OVERLAID = 200
"""Episodes that are drawn over each other at most; of a larger mode every n-th, with its medoid."""


MAX_DRAWN_POSES = 500_000
"""Vehicles times frames that an animation draws at most: some seconds of work."""


MAX_KEPT_POSES = 5_000_000
"""Vehicles times moments of all its scenes: 80 MB."""


class OverlayBounds(NamedTuple):
    """Maximum size of an overlay.

    Attributes:
        episodes: episodes that are drawn over each other.
        drawn_poses: vehicles times frames.
        kept_poses: vehicles times moments of all scenes.
    """

    episodes: int
    drawn_poses: int
    kept_poses: int

    def can_hold(self, scenes: Sequence[Scene]) -> bool:
        """Return whether an animation of some scenes over each other stays within the bounds."""
        steps = max(len(scene.vehicles) for scene in scenes) - 1
        frames = len(list_frame_steps(steps, scenes[0].dt_s))
        vehicles = sum(len(scene.sizes) for scene in scenes)
        kept = sum(len(scene.vehicles) * len(scene.sizes) for scene in scenes)
        return vehicles * frames <= self.drawn_poses and kept <= self.kept_poses


def find_mission(spec: CampaignSpec, result: EpisodeResult) -> Mission | None:
    """Return lanes and time step of an episode's scenario; None if it is not known here.

    It is never known for a bridge, whose scenario may share the name of an installed one.
    """
    if world_of(spec.simulator).needs_bridge:
        return None
    seed = result.seed
    given = spec.scenario_parameters | drawn_for(spec, seed) | placed_for(spec, result.noise)
    try:
        plugin = plugins.load(plugins.SCENARIOS, spec.scenario)
        parameters = read_variation(plugin.Parameters, given).draw(seed)
        mission: Mission = plugin()(parameters, seed).mission
    except EigenfailError:
        return None
    return mission


class RecordingFile(NamedTuple):
    """A file of another tool."""

    content: bytes
    form: RecordingFormat


def make_recording_file(
    store: Store,
    explanations: Explanations,
    episode: tuple[int, int],
    name: str,
    ego: EgoControl,
) -> RecordingFile:
    """Return the file of an episode.

    Args:
        store: store with the episode.
        explanations: runs the episode again if its scene was not kept.
        episode: its campaign and index.
        name: name of the format.
        ego: whether the ego repeats its course or is left to a controller.

    Raises:
        NotFound: the campaign, or the result of the episode, does not exist.
        InvalidValue: the episode is without a scene or too long, or the format cannot be written.
        Conflict: its scene was not kept, and a replay of it differs.
        ServiceError: its scene was not kept, and it cannot be run again here.
    """
    form = check_format(name, ego)
    recording = load_recording(store, explanations, *episode)
    steps, vehicles = recording.scene.vehicles.shape[:2]
    if steps * vehicles > MAX_POSES:
        problem = f"It has {steps} steps of {vehicles} vehicles: {steps * vehicles} poses."
        raise InvalidValue("episode", problem, f"At most {MAX_POSES} are written.")
    return RecordingFile(form.write(recording, ego), form)


def load_recording(
    store: Store, explanations: Explanations, campaign: int, index: int
) -> EpisodeRecording:
    """Return the recording of an episode; raises as `make_recording_file` does."""
    owner, stored = store.campaigns.get(campaign), store.episodes.get(campaign, index)
    spec = owner.spec
    _refuse_sceneless(spec, stored)
    return EpisodeRecording(
        campaign=campaign,
        campaign_name=spec.name,
        index=index,
        recorded_ms=owner.created_ms,
        scenario=spec.scenario,
        planner=spec.planner,
        seed=stored.seed,
        outcome=stored.outcome,
        digest=stored.digest(),
        noise=stored.noise,
        channels=list_channels(spec),
        scene=stored.scene or _replay_scene(store, explanations, campaign, index),
        mission=find_mission(spec, stored),
    )


def _refuse_sceneless(spec: CampaignSpec, stored: EpisodeResult) -> None:
    """Raise InvalidValue for an episode without a scene: of a function, or without a step."""
    _refuse_function(spec, "episode")
    if not stored.steps:
        why = stored.fault.message if stored.fault else "no reason was kept"
        raise InvalidValue("episode", f"It ended before its first step: {why}")


def _refuse_function(spec: CampaignSpec, field: str) -> None:
    if not world_of(spec.simulator).has_road:
        problem = "A function of the noise was tested: its episodes have no vehicles."
        raise InvalidValue(field, problem, "Export the episodes of its campaign as a table.")


def _replay_scene(store: Store, explanations: Explanations, campaign: int, index: int) -> Scene:
    """Return the scene of a replay of an episode whose scene was not kept."""
    scene = explanations.of(store, campaign, index).scene
    if scene is None:
        raise Conflict(
            f"The scene of episode {campaign}/{index} was not kept, and a replay of it differs.",
            "Use the versions and the type of machine of the campaign, or export another episode.",
        )
    return scene


def make_mode_animation(store: Store, analysis: Analysis, mode: int, name: str) -> RecordingFile:
    """Return a file that shows the failures of a mode over each other.

    Args:
        store: store with the episodes.
        analysis: analysis that found the mode.
        mode: number of the mode, from 1.
        name: name of the format.

    Raises:
        NotFound: the analysis does not have the mode.
        Conflict: the analysis is not done, or none of the failures has a scene that can be drawn.
        InvalidValue: the format cannot be written, or the failures come from a function.
    """
    form = find_format(name)
    if form.overlay is None:
        raise InvalidValue("format", f"{name} does not show several episodes over each other.")
    return RecordingFile(form.overlay(load_mode_recordings(store, analysis, mode)), form)


def load_mode_recordings(
    store: Store, analysis: Analysis, mode: int, bounds: OverlayBounds | None = None
) -> OverlaidRecordings:
    """Return the failures of a mode, its medoid first; raises as `make_mode_animation` does.

    If the medoid's scene cannot be drawn, another failure comes first.

    Args:
        store: store with the episodes.
        analysis: analysis that found the mode.
        mode: number of the mode, from 1.
        bounds: limits of the overlay; a larger mode is sampled evenly. None: the limits of a GIF.
    """
    most = bounds or OverlayBounds(MAX_OVERLAID, MAX_DRAWN_POSES, MAX_KEPT_POSES)
    result = read_result(analysis)
    if not 1 <= mode <= len(result.modes):
        raise make_mode_error(analysis.id, mode)
    spec = store.campaigns.get(analysis.campaign).spec
    _refuse_function(spec, "mode")
    found = result.modes[mode - 1]
    medoid = (found.medoid_campaign or analysis.campaign, found.medoid)
    members = [
        (campaign, index)
        for campaign, index, number in result.list_members(analysis.campaign)
        if number == mode and (campaign, index) != medoid
    ]
    first = store.episodes.get(*medoid)
    shown = _choose_scenes(store, [medoid, *members], first, most)
    if not shown:
        raise Conflict(
            f"No failure of mode {mode} of analysis {analysis.id} has a scene that can be drawn.",
            "Export an episode of it: its scene is computed again where it was not kept.",
        )
    spec = store.campaigns.get(medoid[0]).spec
    return OverlaidRecordings(
        title=f"Analysis {analysis.id}, {result.cluster_noun} {mode}",
        scenes=tuple(scene for _, scene, _ in shown),
        outcomes=tuple(outcome for _, _, outcome in shown),
        episodes=tuple(episode for episode, _, _ in shown),
        total=found.failures,
        mission=find_mission(spec, first),
        aligned_at_end=analysis.settings.align == "collision",
        has_medoid=shown[0][0] == medoid,
    )


def _choose_scenes(
    store: Store,
    members: Sequence[tuple[int, int]],
    medoid: EpisodeResult,
    bounds: OverlayBounds,
) -> list[tuple[tuple[int, int], Scene, Outcome]]:
    """Return as many failures as an animation can draw, each with scene and outcome.

    Args:
        store: store with the episodes.
        members: campaign and index of the failures, the medoid first.
        medoid: the episode that the view follows, if its scene can be drawn.
        bounds: limits of the overlay.
    """
    shown: list[tuple[tuple[int, int], Scene, Outcome]] = []
    if medoid.scene is not None and bounds.can_hold([medoid.scene]):
        shown.append((members[0], medoid.scene, medoid.outcome))
    # Were all of them like the medoid, this number would do: so the sample is spread evenly.
    affordable = bounds.episodes
    while shown and affordable > 1 and not bounds.can_hold([shown[0][1]] * affordable):
        affordable -= 1
    others = members[1:]
    places = np.linspace(0, len(others) - 1, min(len(others), affordable - 1)).round()
    for place in places.tolist():
        # One at a time, and the noise of none is kept.
        episode = others[int(place)]
        stored = store.episodes.get(*episode)
        scene = stored.scene
        # Campaigns may differ in their time step, and frames show one time.
        if scene is None or (shown and scene.dt_s != shown[0][1].dt_s):
            continue
        if bounds.can_hold([*(each for _, each, _ in shown), scene]):
            shown.append((episode, scene, stored.outcome))
    return shown
