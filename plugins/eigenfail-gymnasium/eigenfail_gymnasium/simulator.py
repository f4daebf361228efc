"""The simulator `gymnasium`: disturbs what a policy perceives of an environment."""

from typing import Any, ClassVar

import numpy as np
from msgspec.structs import replace

from eigenfail.contracts import Planner, Scenario, Simulation
from eigenfail.errors import InvalidValue, PlannerError, SimulatorError, UnknownName
from eigenfail.values.channels import (
    ALL_CHANNELS,
    CHANNELS_FIELD,
    MOST_CHANNELS,
    OBSERVATION,
    Channel,
    split_name,
)
from eigenfail.values.scene import Control, Observation
from eigenfail.values.shapes import Row
from eigenfail_gymnasium.environments import GymnasiumParameters
from eigenfail_gymnasium.scenario import open_stage
from eigenfail_gymnasium.stages import ChosenAction, ObservedPerception, Stage
from eigenfail_workers.closed_loop import validate_control
from eigenfail_workers.faults import wrap_errors
from eigenfail_workers.motion import clip_control
from eigenfail_workers.perception import SensorErrors

MOST_VEHICLES = 999
"""More than come and go in an episode: a ghost has the next number."""


class GymnasiumSimulator:
    """Opens simulations of environments of Gymnasium.

    Attributes:
        channels: all errors of perceived vehicles, and `observation.N`: an error of number N of
            the observation, from 0, in the observation's own unit.
    """

    channels: ClassVar = ALL_CHANNELS | {f"{OBSERVATION}.{n}" for n in range(MOST_CHANNELS)}
    occludes: ClassVar = True

    def open(
        self,
        scenario: Scenario,  # noqa: ARG002 - its parameters say all of it
        parameters: Any,
        planner: Planner,
        channels: tuple[Channel, ...],
        occlusion: bool = False,
    ) -> Simulation:
        """Return a simulation of the planner, a policy or any other, in the environment.

        Raises:
            UnknownName: the environment, a key of `config` or a number of the observation does not
                exist.
            InvalidValue: the scenario is not `gymnasium`, the environment cannot be made, or it
                lacks vehicles or an array of numbers to disturb.
        """
        if not isinstance(parameters, GymnasiumParameters):
            problem = "the simulator 'gymnasium' stages no other scenario than its own."
            raise InvalidValue("scenario", problem, 'Write scenario = "gymnasium".')
        stage, steps = open_stage(parameters)
        errors = ObservationErrors(channels, occlusion)
        errors.check(stage)
        return GymnasiumSimulation(stage, steps, planner, errors)


class ObservationErrors:
    """Splits a disturbance into errors of vehicles and errors of numbers of an observation.

    Args:
        channels: channels of a disturbance, in order.
        occlusion: whether vehicles that others hide are not detected.
    """

    def __init__(self, channels: tuple[Channel, ...], occlusion: bool) -> None:
        names = [split_name(channel.name) for channel in channels]
        self._numbers = [
            (place, int(name.quantity))
            for place, name in enumerate(names)
            if name.target == OBSERVATION
        ]
        self._vehicles = [place for place, name in enumerate(names) if name.target != OBSERVATION]
        self._occlusion = occlusion
        self._named = channels
        self.of_vehicles = SensorErrors(tuple([channels[p] for p in self._vehicles]), occlusion)

    def check(self, stage: Stage) -> None:
        """Check that an environment has what the channels disturb.

        Raises:
            UnknownName: its observation lacks a number.
            InvalidValue: it lacks vehicles, or its observation is not an array of numbers.
        """
        if not stage.takes_controls and (self._vehicles or self._occlusion):
            problem = "there are no vehicles in this environment, whose position could be wrong."
            remedy = f"Name numbers of its observation, such as {OBSERVATION}.0."
            raise InvalidValue(CHANNELS_FIELD, problem, remedy)
        shape = stage.describe().observation_space.shape
        if self._numbers and shape is None:
            problem = "the observation of this environment is no array of numbers."
            raise InvalidValue(CHANNELS_FIELD, problem, "Take errors of vehicles, if it has any.")
        size = 0 if shape is None else int(np.prod(shape))
        for place, number in self._numbers:
            if number >= size:
                known = [f"{OBSERVATION}.{each}" for each in range(size)]
                field = f"{CHANNELS_FIELD}[{place}].name"
                raise UnknownName(field, self._named[place].name, known)

    def split(self, disturbance: Row) -> Row:
        """Return the errors of vehicles."""
        return tuple([disturbance[place] for place in self._vehicles])

    def add(self, observation: Any, disturbance: Row) -> Any:
        """Return an observation with the errors of its numbers; the given one is not changed."""
        if not self._numbers:
            return observation
        wrong = np.array(observation, copy=True)
        if wrong.dtype.kind != "f":
            wrong = wrong.astype(np.float32)
        flat = wrong.reshape(-1)
        for place, number in self._numbers:
            flat[number] += disturbance[place]
        return wrong


class GymnasiumSimulation:
    """A planner in an environment. Implements `Simulation`.

    An environment may end an episode that has not failed, as at a goal. The last state is then
    shown until the horizon, so that all episodes that do not fail have the same length.

    Args:
        stage: the environment.
        steps: horizon of an episode.
        planner: drives the ego.
        errors: what disturbs its perception.
    """

    def __init__(
        self, stage: Stage, steps: int, planner: Planner, errors: ObservationErrors
    ) -> None:
        self.dt_s = stage.mission.dt_s
        self.steps = steps
        self._stage = stage
        self._planner = planner
        self._errors = errors
        self._planner_errors = wrap_errors(PlannerError, "The planner", "Look into the planner.")
        self._now: Observation | None = None
        self._is_over = False
        self._closed = False

    def reset(self, seed: int) -> Observation:
        """Begin an episode; see `Simulation.reset`."""
        if self._closed:
            raise SimulatorError("The simulation is closed.", "Open another one.")
        self._errors.of_vehicles.reset(MOST_VEHICLES)
        self._now, self._is_over = self._stage.reset(seed), False
        with wrap_errors(PlannerError, "The planner's reset", "Look into the planner."):
            self._planner.reset(self._stage.mission)
        return self._now

    def step(self, disturbance: Row) -> Observation:
        """Perceive, disturb, decide and step; see `Simulation.step`."""
        now = self._now
        if now is None or now.ended or self._closed:
            raise SimulatorError("There is no episode to go on with.", "Reset the simulation.")
        self._now = self._advance(now, disturbance)
        return self._now

    def _advance(self, now: Observation, disturbance: Row) -> Observation:
        stage, errors = self._stage, self._errors
        seen, position = errors.of_vehicles.perceive(now, self.dt_s, errors.split(disturbance))
        decision = ChosenAction()
        perception = ObservedPerception(
            seen.time_s,
            seen.ego,
            seen.others,
            seen.ids,
            observation=errors.add(stage.observe(seen), disturbance),
            task=stage.describe(),
            decision=decision,
        )
        # A step that is broken off leaves no episode to go on with.
        self._now = None
        with self._planner_errors:
            control = validate_control(self._planner.act(perception))
        applied: Control | None = None
        if decision.action is None:
            if not stage.takes_controls:
                problem = "The planner answers accelerations, which this environment cannot take."
                raise PlannerError(problem, 'Write planner = "policy".')
            applied = clip_control(control, now.ego.speed_mps, stage.mission.peak_braking_mps2)
        if self._is_over:
            # The planner is asked all the same: a contract says that it is, at every step.
            later = replace(now, step=now.step + 1, frames=())
        else:
            with self._planner_errors:
                later, self._is_over = stage.advance(now, applied or decision)
        ended = later.collided or later.step >= self.steps
        shown = {
            "ended": ended,
            "perceived": position,
            "control": later.control if applied is None else control,
            "applied": applied,
        }
        frames = tuple([replace(frame, **shown) for frame in later.frames])
        return replace(later, **shown, frames=frames)

    def close(self) -> None:
        """Release the environment, and refuse further steps."""
        if not self._closed:
            self._stage.close()
        self._closed = True
        self._now = None
