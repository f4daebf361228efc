"""One episode with the planner's own account of each step. Registered as an explainer."""

from collections.abc import Callable, Mapping

import msgspec

from eigenfail import functions
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
    Perception,
    Scene,
    VehicleState,
)
from eigenfail_workers.closed_loop import checked
from eigenfail_workers.engine import Engine
from eigenfail_workers.faults import blamed_on
from eigenfail_workers.measures.geometry import nearest, velocity

Told = tuple[float, Control, Account]


def nothing() -> Mapping[str, str | float]:
    """The account of a planner that explains nothing."""
    return {}


class Witness:
    """Drives as its planner does, and keeps what it tells of each step. Implements `Planner`.

    Args:
        planner: an `ExplainingPlanner`, or any other.
        told: filled with time, control and account of each step of the last episode.
    """

    def __init__(self, planner: Planner, told: list[Told]) -> None:
        self._planner = planner
        self._explain: Callable[[], Mapping[str, str | float]]
        self._explain = getattr(planner, "explain", nothing)
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
        self._told.append((perception.time_s, control, account))
        return control


def plain(value: object) -> str | float:
    """A number as a float, anything else as text."""
    return float(value) if isinstance(value, (int, float)) else str(value)


def explain(setup: EpisodeSetup, task: EpisodeTask) -> ExplainedEpisode:
    """Run an episode and ask the planner why; see `Explainer`."""
    refuse_functions(setup)
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


def refuse_functions(setup: EpisodeSetup) -> None:
    """Raises InvalidValue where there is no planner that could explain anything."""
    if setup.simulator == functions.SIMULATOR:
        problem = "a function explains nothing: there is no planner, and there are no controls."
        remedy = "Run it again with `eigenfail episode replay`."
        raise InvalidValue("episode", problem, remedy)


def _step(number: int, told: Told, result: EpisodeResult) -> ExplainedStep:
    time_s, control, account = told
    longitudinal, lateral = result.noise.standardised[number].tolist()
    gap_m, closing_mps = _truth(result.scene, number) if result.scene else (None, None)
    return ExplainedStep(
        time_s=time_s,
        acceleration_mps2=control.acceleration_mps2,
        steering_rad=control.steering_rad,
        account=account,
        disturbance=(longitudinal, lateral),
        gap_m=gap_m,
        closing_mps=closing_mps,
    )


def _truth(scene: Scene, step: int) -> tuple[float, float]:
    """Gap to the nearest vehicle along the road [m], and how fast it closes [m/s]."""
    poses = zip(scene.vehicles[step].tolist(), scene.sizes.tolist(), strict=True)
    ego, *others = (VehicleState(*pose, *size) for pose, size in poses)
    actor = others[nearest(ego, others)]
    gap_m = actor.x_m - ego.x_m - (ego.length_m + actor.length_m) / 2.0
    return gap_m, velocity(ego)[0] - velocity(actor)[0]
