"""One episode with the planner's own account of each step. Registered as an explainer."""

from collections.abc import Callable, Mapping, Sequence
from typing import NamedTuple

import msgspec

from eigenfail import bridges, functions
from eigenfail.contracts import Planner
from eigenfail.errors import InvalidValue, PlannerError
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
from eigenfail_workers.closed_loop import checked
from eigenfail_workers.engine import Engine
from eigenfail_workers.faults import blamed_on
from eigenfail_workers.measures.geometry import nearest, velocity

MOST_POINTS = 20
"""Of a path: more are left out, evenly."""


class Told(NamedTuple):
    """What was decided in a step, and what the planner says of it."""

    time_s: float
    control: Control
    account: Account
    path: Path


def nowhere() -> Sequence[tuple[float, float]]:
    """The path of a planner that tells none."""
    return ()


def nothing() -> Mapping[str, str | float]:
    """The account of a planner that explains nothing."""
    return {}


class Witness:
    """Drives as its planner does, and keeps what it tells of each step. Implements `Planner`.

    Args:
        planner: an `ExplainingPlanner`, a `PlottingPlanner`, both, or any other.
        told: filled with each step of the last episode.
    """

    def __init__(self, planner: Planner, told: list[Told]) -> None:
        self._planner = planner
        self._explain: Callable[[], Mapping[str, str | float]]
        self._explain = getattr(planner, "explain", nothing)
        self._path: Callable[[], Sequence[tuple[float, float]]]
        self._path = getattr(planner, "path", nowhere)
        self._told = told

    def reset(self, mission: Mission) -> None:
        """A new episode begins."""
        self._told.clear()
        self._planner.reset(mission)

    def act(self, perception: Perception) -> Control:
        """What the planner decides; then it is asked why."""
        control = checked(self._planner.act(perception))
        with blamed_on(PlannerError, "The planner's account", "Look into its `explain`."):
            account = {str(name): plain(value) for name, value in self._explain().items()}
        with blamed_on(PlannerError, "The planner's path", "Look into its `path`."):
            path = thinned(self._path())
        self._told.append(Told(perception.time_s, control, account, path))
        return control


def plain(value: object) -> str | float:
    """A number as a float, anything else as text."""
    return float(value) if isinstance(value, (int, float)) else str(value)


def thinned(path: Sequence[tuple[float, float]]) -> Path:
    """A path of at most so many points, its ends included."""
    last = len(path) - 1
    kept: Sequence[int] = range(last + 1)
    if last >= MOST_POINTS:
        kept = [place * last // (MOST_POINTS - 1) for place in range(MOST_POINTS)]
    return tuple((float(path[place][0]), float(path[place][1])) for place in kept)


def explain(setup: EpisodeSetup, task: EpisodeTask) -> ExplainedEpisode:
    """Run an episode and ask the planner why; see `Explainer`."""
    refuse_strangers(setup)
    told: list[Told] = []
    engine = Engine(
        msgspec.structs.replace(setup, scene_every=1), lambda planner: Witness(planner, told)
    )
    try:
        (result,) = engine.run([task])
    finally:
        engine.close()
    steps = (_step(number, said, result) for number, said in enumerate(told))
    return ExplainedEpisode(result, tuple(steps))


def refuse_strangers(setup: EpisodeSetup) -> None:
    """Raises InvalidValue where there is no planner that could explain anything."""
    why = {
        functions.SIMULATOR: "a function explains nothing: there is no planner, and no controls.",
        bridges.SIMULATOR: "a bridge explains nothing: what its planner thinks, it does not tell.",
    }.get(setup.simulator)
    if why:
        raise InvalidValue("episode", why, "Run it again with `eigenfail episode replay`.")


def _step(number: int, told: Told, result: EpisodeResult) -> ExplainedStep:
    longitudinal, lateral = result.noise.standardised[number].tolist()
    gap_m, closing_mps = _truth(result.scene, number) if result.scene else (None, None)
    return ExplainedStep(
        time_s=told.time_s,
        acceleration_mps2=told.control.acceleration_mps2,
        steering_rad=told.control.steering_rad,
        account=told.account,
        disturbance=(longitudinal, lateral),
        gap_m=gap_m,
        closing_mps=closing_mps,
        path=told.path,
    )


def _truth(scene: Scene, step: int) -> tuple[float, float]:
    """Gap to the nearest vehicle along the road [m], and how fast it closes [m/s]."""
    poses = zip(scene.vehicles[step].tolist(), scene.sizes.tolist(), strict=True)
    ego, *others = (VehicleState(*pose, *size) for pose, size in poses)
    actor = others[nearest(ego, others)]
    gap_m = actor.x_m - ego.x_m - (ego.length_m + actor.length_m) / 2.0
    return gap_m, velocity(ego)[0] - velocity(actor)[0]
