"""A world and a planner, closed into a simulation: perceive, disturb, plan, step."""

from math import isfinite
from typing import Any, Protocol

import msgspec

from eigenfail.contracts import Planner, Scenario, Situation
from eigenfail.errors import InvalidValue, PlannerError, SimulatorError
from eigenfail.values import Control, Mission, Observation, Perception, VehicleState
from eigenfail_workers.faults import blamed_on
from eigenfail_workers.measures.geometry import nearest
from eigenfail_workers.road import is_off_road
from eigenfail_workers.truck import within_limits

Pair = tuple[float, float]


class Truth(msgspec.Struct, frozen=True, gc=False):
    """Where everybody is, and whether the ego touches anybody."""

    ego: VehicleState
    others: tuple[VehicleState, ...]
    collided: bool


class World(Protocol):
    """Physics: moves the ego by its controls and the actors by their script."""

    def reset(self, situation: Situation) -> Truth:
        """Stage the situation."""

    def advance(self, control: Control) -> Truth:
        """Move everybody by one step of the situation's `dt_s`."""


class DrivenSimulation:
    """A planner driving the ego of a scenario in a world. Implements `Simulation`.

    `dt_s` and `steps` belong to the scenario's parameters; they are the same for every seed.
    """

    def __init__(self, world: World, scenario: Scenario, parameters: Any, planner: Planner) -> None:
        self._world = world
        self._scenario = scenario
        self._parameters = parameters
        self._planner = planner
        situation = scenario(parameters, 0)
        self.dt_s = situation.mission.dt_s
        self.steps = situation.steps
        self._mission: Mission = situation.mission
        self._now: Observation | None = None
        self._closed = False

    def reset(self, seed: int) -> Observation:
        """Begin an episode; see `Simulation.reset`."""
        if self._closed:
            raise SimulatorError("The simulation is closed.", "Open another one.")
        situation = self._scenario(self._parameters, seed)
        truth = self._stage(situation)
        self._mission = situation.mission
        with blamed_on(PlannerError, "The planner's reset", "Look into the planner."):
            self._planner.reset(situation.mission)
        off_road = is_off_road(situation.mission, truth.ego)
        self._now = Observation(0, truth.ego, truth.others, off_road=off_road)
        return self._now

    def _stage(self, situation: Situation) -> Truth:
        if not situation.actors:
            raise InvalidValue(
                "scenario_parameters",
                "there is no vehicle beside the ego.",
                "Stage one at least: noise is on the position of the nearest.",
            )
        truth = self._world.reset(situation)
        if truth.collided:
            raise InvalidValue(
                "scenario_parameters", "the ego starts in a collision.", "Start it further away."
            )
        return truth

    def step(self, disturbance: Pair) -> Observation:
        """Perceive, disturb, plan and step; see `Simulation.step`."""
        now = self._now
        if now is None or now.ended or self._closed:
            raise SimulatorError("There is no episode to go on with.", "Reset the simulation.")
        perception, position = self._perceive(now, disturbance)
        control = self._plan(perception)
        applied = within_limits(control, now.ego.speed_mps)
        truth = self._world.advance(applied)
        step = now.step + 1
        self._now = Observation(
            step=step,
            ego=truth.ego,
            others=truth.others,
            collided=truth.collided,
            ended=truth.collided or step >= self.steps,
            perceived=position,
            control=control,
            applied=applied,
            off_road=is_off_road(self._mission, truth.ego),
        )
        return self._now

    def _perceive(self, now: Observation, disturbance: Pair) -> tuple[Perception, Pair]:
        """What the planner sees: the truth, but for the position of the nearest vehicle."""
        actor = nearest(now.ego, now.others)
        true = now.others[actor]
        position = true.x_m + disturbance[0], true.y_m + disturbance[1]
        seen = VehicleState(
            *position, true.heading_rad, true.speed_mps, true.length_m, true.width_m
        )
        others = (*now.others[:actor], seen, *now.others[actor + 1 :])
        return Perception(now.step * self.dt_s, now.ego, others), position

    def _plan(self, perception: Perception) -> Control:
        with blamed_on(PlannerError, "The planner", "Look into the planner."):
            return checked(self._planner.act(perception))

    def close(self) -> None:
        """Let go of the episode."""
        self._closed = True
        self._now = None


def checked(answer: object) -> Control:
    """A planner's answer, if it is a control.

    Raises:
        PlannerError: it is something else, or holds what is not a finite number.
    """
    remedy = "`act` must return a Control of two finite numbers."
    if not isinstance(answer, Control):
        raise PlannerError(f"The planner returned {type(answer).__name__}.", remedy)
    if not (isfinite(answer.acceleration_mps2) and isfinite(answer.steering_rad)):
        raise PlannerError(f"The planner returned {answer}.", remedy)
    return Control(float(answer.acceleration_mps2), float(answer.steering_rad))
