"""The scenario `gymnasium`: an environment by its id."""

from collections.abc import Callable
from typing import Any, ClassVar

from eigenfail.errors import SimulatorError
from eigenfail.values.scene import Mission, VehicleState
from eigenfail_gymnasium.declared import load_declared
from eigenfail_gymnasium.environments import (
    FIELD,
    GymnasiumParameters,
    find_horizon,
    find_time_step,
    is_road,
    make_environment,
)
from eigenfail_gymnasium.margins import MarginStage
from eigenfail_gymnasium.road import RoadStage
from eigenfail_gymnasium.stages import Stage


class StagedEnvironment:
    """An environment at its start. Implements `Situation`; only its own simulator moves it.

    Attributes:
        mission: lanes at the ego, as if they were parallel to x.
        steps: horizon of an episode.
        ego: initial state of the ego.
        actors: initial states of all vehicles except the ego.
    """

    def __init__(
        self, mission: Mission, steps: int, ego: VehicleState, actors: tuple[VehicleState, ...]
    ) -> None:
        self.mission, self.steps, self.ego, self.actors = mission, steps, ego, actors

    def move_actor(self, actor: int, step: int, ego: VehicleState) -> VehicleState:  # noqa: ARG002
        """Refuse to move a vehicle.

        Raises:
            SimulatorError: always.
        """
        problem = "Vehicles of a Gymnasium environment are moved by the environment."
        raise SimulatorError(problem, 'Write simulator = "gymnasium".')


class GymnasiumScenario:
    """Makes the environment of a campaign, to say how it begins and how long it is."""

    Parameters: ClassVar = GymnasiumParameters

    def __call__(self, parameters: GymnasiumParameters, seed: int) -> StagedEnvironment:
        """Return an environment at its start.

        Raises:
            UnknownName: the environment or a key of `config` does not exist.
            InvalidValue: the environment cannot be made.
        """
        stage, steps = open_stage(parameters)
        try:
            start = stage.reset(seed)
            return StagedEnvironment(stage.mission, steps, start.ego, start.others)
        finally:
            stage.close()


def open_stage(parameters: GymnasiumParameters) -> tuple[Stage, int]:
    """Return a newly made environment, and its horizon.

    Raises:
        UnknownName: the environment or a key of `config` does not exist.
        InvalidValue: the environment cannot be made.
    """
    env = make_environment(parameters)
    steps, dt_s = find_horizon(env, parameters), find_time_step(env, parameters)
    if is_road(env):
        return RoadStage(env, dt_s, steps), steps
    measure: Callable[[Any, dict[str, Any]], float] | None = None
    if parameters.margin:
        measure = load_declared(parameters.margin, "margin", f"{FIELD}.margin")
    return MarginStage(env, parameters, measure, dt_s), steps
