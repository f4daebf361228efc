"""One episode with the planner's own explanation of each step. Registered as an explainer."""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import msgspec

from eigenfail.contracts import Planner
from eigenfail.errors import InvalidValue, PlannerError, read_text
from eigenfail.values import (
    Account,
    Control,
    EpisodeResult,
    EpisodeSetup,
    EpisodeTask,
    ExplainedEpisode,
    ExplainedStep,
    Mission,
    Path,
    Perception,
    Scene,
    VehicleState,
)
from eigenfail.worlds import world_of
from eigenfail_workers.closed_loop import validate_control
from eigenfail_workers.engine import Engine
from eigenfail_workers.faults import wrap_errors
from eigenfail_workers.measures.geometry import find_nearest, velocity

MAX_POINTS = 20
"""Most points that are kept of a path, evenly chosen."""


class RecordedStep(NamedTuple):
    """The planner's decision in a step, and its explanation."""

    time_s: float
    control: Control
    account: Account
    path: Path


class RecordingPlanner:
    """Drives as its planner does, and records the explanation of each step. Implements `Planner`.

    Args:
        planner: any planner; those with `explain` or `path` are asked for them.
        steps: list that is filled with the steps of the last episode.
    """

    def __init__(self, planner: Planner, steps: list[RecordedStep]) -> None:
        self._planner = planner
        self._explain: Callable[[], Mapping[str, str | float]]
        self._explain = getattr(planner, "explain", dict)
        self._path: Callable[[], Sequence[tuple[float, float]]]
        self._path = getattr(planner, "path", tuple)
        self._steps = steps

    def reset(self, mission: Mission) -> None:
        """Begin a new episode."""
        self._steps.clear()
        self._planner.reset(mission)

    def act(self, perception: Perception) -> Control:
        """Return the planner's control, after recording its explanation."""
        control = validate_control(self._planner.act(perception))
        with wrap_errors(PlannerError, "The planner's account", "Look into its `explain`."):
            account = {read_text(name): _to_plain(value) for name, value in self._explain().items()}
        with wrap_errors(PlannerError, "The planner's path", "Look into its `path`."):
            path = _thin_path(self._path())
        self._steps.append(RecordedStep(perception.time_s, control, account, path))
        return control


def _to_plain(value: object) -> str | float:
    return float(value) if isinstance(value, (int, float)) else read_text(value)


def _thin_path(path: Sequence[tuple[float, float]]) -> Path:
    """Return at most MAX_POINTS points of a path, its ends included."""
    last = len(path) - 1
    kept: Sequence[int] = range(last + 1)
    if last >= MAX_POINTS:
        kept = [place * last // (MAX_POINTS - 1) for place in range(MAX_POINTS)]
    return tuple((float(path[place][0]), float(path[place][1])) for place in kept)


def explain(setup: EpisodeSetup, task: EpisodeTask) -> ExplainedEpisode:
    """Run an episode and record the planner's explanations; see `Explainer`.

    Raises:
        InvalidValue: the campaign has no planner in this process that could explain anything.
    """
    if why := world_of(setup.simulator).unexplained:
        raise InvalidValue("episode", why, "Run it again with `eigenfail episode replay`.")
    recorded: list[RecordedStep] = []
    engine = Engine(
        msgspec.structs.replace(setup, scene_every=1),
        lambda planner: RecordingPlanner(planner, recorded),
    )
    try:
        (result,) = engine.run([task])
    finally:
        engine.close()
    steps = (_make_step(number, step, result) for number, step in enumerate(recorded))
    return ExplainedEpisode(result, tuple(steps))


def _make_step(number: int, step: RecordedStep, result: EpisodeResult) -> ExplainedStep:
    gap_m, closing_mps = _measure_gap(result.scene, number) if result.scene else (None, None)
    return ExplainedStep(
        time_s=step.time_s,
        acceleration_mps2=step.control.acceleration_mps2,
        steering_rad=step.control.steering_rad,
        account=step.account,
        disturbance=tuple(result.noise.standardised[number].tolist()),
        gap_m=gap_m,
        closing_mps=closing_mps,
        path=step.path,
    )


def _measure_gap(scene: Scene, step: int) -> tuple[float, float]:
    """Return the true gap to the nearest vehicle [m], and its closing speed [m/s]."""
    poses = zip(scene.vehicles[step].tolist(), scene.sizes.tolist(), strict=True)
    ego, *others = (VehicleState(*pose, *size) for pose, size in poses)
    actor = others[find_nearest(ego, others)]
    gap_m = actor.x_m - ego.x_m - (ego.length_m + actor.length_m) / 2.0
    return gap_m, velocity(ego)[0] - velocity(actor)[0]
