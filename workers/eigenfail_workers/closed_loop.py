"""A world and a planner, closed into a simulation: perceive, disturb, plan, step."""

from collections.abc import Callable
from typing import Any, Protocol

from eigenfail.contracts import Planner, ReactiveSituation, Scenario, Situation
from eigenfail.errors import InvalidValue, PlannerError, SimulatorError
from eigenfail.values.arrays import RANGE, fits_float32
from eigenfail.values.scene import Control, Mission, Observation
from eigenfail.values.shapes import Row
from eigenfail_workers.faults import wrap_errors
from eigenfail_workers.measures.encounters import make_start_error
from eigenfail_workers.measures.geometry import find_struck
from eigenfail_workers.motion import clip_control, find_lane, is_off_road
from eigenfail_workers.perception import SensorErrors
from eigenfail_workers.values import GroundTruth


class TrafficWorld(Protocol):
    """Physics: moves the ego by its controls, and the actors by their scripts."""

    def reset(self, situation: Situation | ReactiveSituation) -> GroundTruth:
        """Place the vehicles of the situation."""

    def advance(self, control: Control) -> GroundTruth:
        """Move all vehicles by one step of the situation's `dt_s`."""


class DrivenSimulation:
    """A planner that drives the ego of a scenario in a world. Implements `Simulation`.

    `dt_s` and `steps` belong to the scenario's parameters; they are the same for every seed.
    """

    def __init__(
        self,
        world: TrafficWorld,
        scenario: Scenario,
        parameters: Any,
        planner: Planner,
        errors: SensorErrors,
    ) -> None:
        self._errors = errors
        self._world = world
        self._scenario = scenario
        self._parameters = parameters
        self._planner = planner
        self._planner_errors = wrap_errors(PlannerError, "The planner", "Look into the planner.")
        self._count_losses: Callable[[int], int] | None = getattr(planner, "count_losses", None)
        self._challenges: tuple[str, ...] = ()
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
        self._challenges = situation.challenges if isinstance(situation, ReactiveSituation) else ()
        self._errors.reset(len(self._challenges))
        truth = self._stage(situation)
        self._mission = situation.mission
        with wrap_errors(PlannerError, "The planner's reset", "Look into the planner."):
            self._planner.reset(situation.mission)
        self._now = Observation(
            0,
            truth.ego,
            truth.others,
            off_road=is_off_road(situation.mission, truth.ego),
            lane=find_lane(situation.mission, truth.ego),
            ids=truth.ids,
            peak_braking_mps2=situation.mission.peak_braking_mps2,
        )
        return self._now

    def _stage(self, situation: Situation | ReactiveSituation) -> GroundTruth:
        if not situation.actors:
            raise InvalidValue(
                "scenario_parameters",
                "there is no vehicle beside the ego.",
                "Stage one at least: noise is on the position of the nearest.",
            )
        truth = self._world.reset(situation)
        if truth.collided:
            raise make_start_error()
        return truth

    def step(self, disturbance: Row) -> Observation:
        """Perceive, disturb, plan and step; see `Simulation.step`."""
        now = self._now
        if now is None or now.ended or self._closed:
            raise SimulatorError("There is no episode to go on with.", "Reset the simulation.")
        perception, position = self._errors.perceive(now, self.dt_s, disturbance)
        with self._planner_errors:
            control = validate_control(self._planner.act(perception))
        # Clipped before the world moves: the limits of the truck are the same in every physics.
        applied = clip_control(control, now.ego.speed_mps, self._mission.peak_braking_mps2)
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
            lane=find_lane(self._mission, truth.ego),
            ids=truth.ids,
            cause=self._find_cause(truth) if truth.collided and self._challenges else None,
        )
        return self._now

    def _find_cause(self, truth: GroundTruth) -> str:
        """Return the challenge of the struck vehicle, and whether its track was lost before."""
        place = find_struck(truth.ego, truth.others)
        number = place + 1 if truth.ids is None else truth.ids[place]
        challenge = self._challenges[number - 1]
        if self._count_losses is None:
            return challenge
        with self._planner_errors:
            lost = self._count_losses(number) > 0
        return f"{challenge}, track {'lost' if lost else 'kept'}"

    def close(self) -> None:
        """Refuse further steps."""
        self._closed = True
        self._now = None


def validate_control(answer: object) -> Control:
    """Return a planner's answer as a control.

    Raises:
        PlannerError: the answer is not a control, or holds NaN or infinity.
    """
    remedy = f"`act` must return a Control of two finite numbers {RANGE}."
    if not isinstance(answer, Control):
        raise PlannerError(f"The planner returned {type(answer).__name__}.", remedy)
    if not (fits_float32(answer.acceleration_mps2) and fits_float32(answer.steering_rad)):
        raise PlannerError(f"The planner returned {answer}.", remedy)
    # Converted where they come in: compiled code takes what is annotated as a float for one.
    return Control(float(answer.acceleration_mps2), float(answer.steering_rad))
