"""Episodes and failure modes explained: accounts of planners, tables of steps, single replays."""

import contextlib
import csv
import io
import time
from collections import OrderedDict
from collections.abc import Callable, Iterator
from functools import partial
from hashlib import sha256
from threading import Lock, Thread

import msgspec

from eigenfail import plugins
from eigenfail.contracts import Explainer
from eigenfail.errors import EigenfailError, InvalidValue
from eigenfail.explanations import encode_question, explain_in_process
from eigenfail.process_state import ProcessState
from eigenfail.replays import add_undisturbed, make_replay_task
from eigenfail.values import episode
from eigenfail.values.analysis import Analysis, AnalysisResult, FailureMode
from eigenfail.values.campaign import Campaign
from eigenfail.values.campaign_spec import LONGEST_NAME, StopRules
from eigenfail.values.channels import name_columns
from eigenfail.values.disturbance import list_noise
from eigenfail.values.proof import ExplainedEpisode, Explanation
from eigenfail.values.scene import Scene
from eigenfail.worlds import drawn_for, list_channels, resolve_disturbance, world_of
from eigenfail_services.analysis.footprints import measure_clearances
from eigenfail_services.analysis.words import Clock, describe, describe_account
from eigenfail_services.campaigns.validation import check_spec
from eigenfail_services.store.store import Store

KEPT = 32


Explain = Callable[[bytes], Explanation]


class Explanations:
    """Explanations of episodes, computed when first asked for, one at a time.

    Args:
        explain: answers a question of `eigenfail.explanations.encode_question`.
    """

    def __init__(self, explain: Explain = explain_in_process) -> None:
        self._explain = explain
        self._making = Lock()
        self._made: OrderedDict[bytes, Explanation] = OrderedDict()

    def of(self, store: Store, campaign: int, index: int) -> Explanation:
        """Return the planner's account of an episode; the first time takes seconds.

        Raises:
            NotFound: the campaign, or the result of the episode, does not exist.
            InvalidValue: the episode does not have a course to explain.
            ServiceError: the world is not installed here, or the answer did not come in time.
        """
        spec = store.campaigns.get(campaign).spec
        asked = encode_question(campaign, spec, store.episodes.get(campaign, index))
        key = sha256(asked).digest()
        with self._making:
            explanation = self._made.get(key) or self._explain(asked)
            if world_of(spec.simulator).needs_bridge:
                return explanation  # A bridge that fails now, or is mended later, says another.
            self._made[key] = explanation
            self._made.move_to_end(key)
            while len(self._made) > KEPT:
                self._made.popitem(last=False)
        return explanation


CONTROLS = ("acceleration_mps2", "steering_rad", "perceived_x_m", "perceived_y_m", "clearance_m")


STATE = ("x_m", "y_m", "heading_rad", "speed_mps")


def write_steps(result: episode.EpisodeResult, channels: tuple[str, ...]) -> str:
    """Return one CSV row for each step: its noise and, if the scene was kept, all vehicles.

    Args:
        result: the episode.
        channels: names of the channels of its noise.
    """
    text = io.StringIO()
    writer = csv.writer(text, lineterminator="\n")
    scene, columns = result.scene, _name_noise_columns(channels)
    writer.writerow((*columns, "log_probability", *(_list_columns(scene) if scene else ())))
    rows = _list_scene_rows(scene) if scene else iter([()] * result.steps)
    likely = map(float, result.noise.log_probability_per_step)
    steps = zip(list_noise(result.noise, channels), likely, rows, strict=True)
    writer.writerows((*(row[name] for name in columns), log_p, *more) for row, log_p, more in steps)
    return text.getvalue()


def _name_noise_columns(channels: tuple[str, ...]) -> tuple[str, ...]:
    # Those of `list_noise`: an episode without a step has no row to take them from.
    by_quantity = zip(*(name_columns(channel) for channel in channels), strict=True)
    return ("step", *(name for names in by_quantity for name in names))


def _list_columns(scene: Scene) -> Iterator[str]:
    yield from ("time_s", *CONTROLS)
    for number in range(len(scene.sizes)):
        who = "ego" if number == 0 else f"vehicle_{number}"
        yield from (f"{who}_{name}" for name in STATE)


def _list_scene_rows(scene: Scene) -> Iterator[tuple[float, ...]]:
    apart = measure_clearances(scene).min(axis=1)
    for step, (control, seen) in enumerate(zip(scene.controls, scene.perceived, strict=True)):
        states = scene.vehicles[step].ravel()
        yield tuple(map(float, (step * scene.dt_s, *control, *seen, apart[step], *states)))


def replay_episode(
    store: Store, campaign: int, index: int, scale: float, made_by: int | None = None
) -> Campaign:
    """Queue a campaign that replays an episode in the scenario it drew, and keeps the scene.

    Args:
        store: store with the episode.
        campaign: campaign of the episode.
        index: index of the episode.
        scale: scale of the noise; 1 injects it as it was.
        made_by: id of the key of the request.

    Raises:
        NotFound: the campaign, or the result of the episode, does not exist.
        InvalidValue: the episode ended before its first step, without any noise.
        UnknownName: a plug-in of the campaign is not installed here.
        QuotaExceeded: the key does not allow another campaign.
    """
    spec = store.campaigns.get(campaign).spec
    stored = store.episodes.get(campaign, index)
    # An episode that ended before its first step was given no noise.
    if not stored.steps:
        why = stored.fault.message if stored.fault else "no reason was kept"
        raise InvalidValue("episode", f"It has no noise to replay: {why}")
    scaled = f", noise × {scale:g}" if scale != 1.0 else ""
    wanted = msgspec.structs.replace(
        spec,
        name=f"{spec.name}: replay of {campaign}/{index}{scaled}"[-LONGEST_NAME:],
        method="replay",
        settings={"campaign": campaign, "episodes": [index], "scale": scale},
        episodes=1,
        stop=StopRules(),
        scene_every=1,
        scenario_parameters={**spec.scenario_parameters, **drawn_for(spec, stored.seed)},
    )
    return store.campaigns.create(check_spec(wanted), made_by=made_by)


PATIENCE_S = 60.0
"""Time for the accounts of all episodes of an analysis: after it no planner is asked. [s]"""


def describe_modes(
    store: Store, analysis: Analysis, result: AnalysisResult, step_s: float | None
) -> tuple[str, ...]:
    """Describe each mode in a few sentences, in the order of the modes.

    Args:
        store: store with the medoids.
        analysis: analysis that found the modes.
        result: result of the analysis.
        step_s: duration of a step; None if it has none. [s]
    """
    until_s = time.monotonic() + PATIENCE_S
    behaviours = [""] * len(result.modes)
    if result.behaviour:
        behaviours = [f"{mode.words} " for mode in result.behaviour.modes]
    return tuple(
        f"Mode {number}: {moved}{_describe_mode(store, analysis.campaign, mode, step_s, until_s)}"
        for number, (moved, mode) in enumerate(zip(behaviours, result.modes, strict=True), start=1)
    )


def _describe_mode(
    store: Store, campaign: int, mode: FailureMode, step_s: float | None, until_s: float
) -> str:
    """Describe the eigenfailure of a mode, its medoid, and what the planner did in the medoid.

    Times refer to the medoid: an eigenfailure does not have an impact until it is replayed.
    """
    campaign = mode.medoid_campaign or campaign
    medoid = store.episodes.get(campaign, mode.medoid)
    shown = f"Its medoid is episode {campaign}/{mode.medoid}"
    spec = store.campaigns.get(campaign).spec
    end = "impact" if medoid.outcome is episode.Outcome.COLLISION else "end"
    clock = Clock(medoid.steps, step_s, f"its medoid's {end}")
    acted = clock._replace(event=f"the {end}")
    account = _describe_account(spec.setup(), medoid, acted, until_s)
    text = f"{shown}; {account}" if account else f"{shown}."
    channels = list_channels(spec)
    words = describe(mode.eigenfailure, clock, channels, spec.disturbance.noise_shape)
    return f"{words} {text}"


def _describe_account(
    setup: episode.EpisodeSetup, medoid: episode.EpisodeResult, clock: Clock, until_s: float
) -> str:
    """Describe what the planner did in an episode; empty without an account in time.

    The planner runs in a separate thread, so its errors do not affect the analysis. A planner that
    never answers leaves only one thread behind, since it uses up the time of all further modes.

    Args:
        setup: setup of the episode's campaign.
        medoid: the episode.
        clock: its times.
        until_s: time of `time.monotonic` until which to wait for the planner. [s]
    """
    accounts: list[str] = []

    def ask() -> None:
        # Each account is kept at once: the second one may come too late.
        accounts.extend(
            describe_account(explained, clock)
            for explained in _explain_episode(setup, medoid)
            if explained.result.digest() == medoid.digest()
        )

    left_s = until_s - time.monotonic()
    # A bridge may serve one session at a time, that of a worker, and is asked by users alone.
    if left_s > 0.0 and not world_of(setup.simulator).needs_bridge:
        before = ProcessState()
        asking = Thread(target=ask, daemon=True)
        asking.start()
        asking.join(left_s)
        # What the planner has changed here must not change what this process goes on to compute.
        if before.changes():
            before.restore()
    return accounts[-1] if accounts else ""


def _explain_episode(
    setup: episode.EpisodeSetup, stored: episode.EpisodeResult
) -> Iterator[ExplainedEpisode]:
    """Yield an episode with the planner's account, then with its course without noise, too.

    Yield nothing if workers are not installed, or if the planner is missing or fails.
    """
    with contextlib.suppress(EigenfailError):
        explainer: Explainer = plugins.load(plugins.EXPLAINERS, "default")
        explain = partial(explainer, setup)
        explained = explain(make_replay_task(stored))
        yield explained
        yield add_undisturbed(explained, explain, stored, resolve_disturbance(setup))
