"""A simulator of one's own: a truck whose brakes take a moment. docs/own_simulator.md"""

from collections.abc import Sequence
from math import cos, hypot, isfinite, sin
from typing import Any

from msgspec.structs import replace

from eigenfail.contracts import Planner, Scenario, Simulation, Situation
from eigenfail.errors import PlannerError, SimulatorError
from eigenfail.values.channels import Channel
from eigenfail.values.disturbance import AXES
from eigenfail.values.scene import Control, Observation, Perception, VehicleState

LAG_S = 0.3
GAS_MPS2 = 2.0

Others = tuple[VehicleState, ...]


class LaggingSimulation:
    """One planner in one scenario (contract `Simulation`)."""

    _situation: Situation
    _last: Observation | None

    def __init__(
        self, scenario: Scenario, parameters: Any, planner: Planner, places: dict[str, int]
    ) -> None:
        self._scenario, self._parameters, self._planner = scenario, parameters, planner
        self._places = places
        self._closed = False
        self._begin(0)
        self.dt_s, self.steps = self._situation.mission.dt_s, self._situation.steps

    def reset(self, seed: int) -> Observation:
        """Stage the situation: nobody has decided on anything yet."""
        if self._closed:
            raise SimulatorError("The simulation is closed.", "Open another one.")
        self._begin(seed)
        self._planner.reset(self._situation.mission)
        situation = self._situation
        brakes_mps2 = situation.mission.peak_braking_mps2
        self._last = Observation(0, situation.ego, situation.actors, peak_braking_mps2=brakes_mps2)
        return self._last

    def step(self, disturbance: tuple[float, ...]) -> Observation:
        """Show the planner a disturbed world, and do in the true one what it decides."""
        if self._last is None or self._last.ended:
            raise SimulatorError("No episode is going on.", "Reset the simulation first.")
        step, truth = self._last.step + 1, self._last
        by = [disturbance[self._places[name]] if name in self._places else 0.0 for name in AXES]
        nearest, seen = disturbed(truth, by)
        ids = tuple(range(1, len(seen) + 1))
        control = self._decide(Perception((step - 1) * self.dt_s, truth.ego, seen, ids))
        ego, others = self._move(step, truth.ego, control)
        collided = any(overlap(ego, other) for other in others)
        self._last = Observation(
            step,
            ego,
            others,
            collided=collided,
            ended=collided or step == self.steps,
            perceived=(seen[nearest].x_m, seen[nearest].y_m),
            control=control,
            applied=Control(self._acceleration, control.steering_rad),
        )
        return self._last

    def close(self) -> None:
        """There is nothing to let go of, but nothing more to be had."""
        self._closed, self._last = True, None

    def _begin(self, seed: int) -> None:
        self._situation = self._scenario(self._parameters, seed)
        self._acceleration, self._last = 0.0, None

    def _decide(self, perception: Perception) -> Control:
        try:
            control = self._planner.act(perception)
            usable = isfinite(control.acceleration_mps2) and isfinite(control.steering_rad)
        except Exception as error:
            self._last = None
            raise PlannerError(f"The planner raised {type(error).__name__}: {error}.") from error
        if not usable:
            self._last = None
            raise PlannerError(f"The planner answered {control}.", "Return finite numbers.")
        return control

    def _move(self, step: int, ego: VehicleState, control: Control) -> tuple[VehicleState, Others]:
        """The truck follows what was asked for with a lag; then the actors play their script."""
        brakes_mps2 = self._situation.mission.peak_braking_mps2
        asked = min(max(control.acceleration_mps2, -brakes_mps2), GAS_MPS2)
        self._acceleration += (asked - self._acceleration) * self.dt_s / LAG_S
        travelled_m = ego.speed_mps * self.dt_s
        moved = replace(
            ego,
            x_m=ego.x_m + travelled_m * cos(ego.heading_rad),
            y_m=ego.y_m + travelled_m * sin(ego.heading_rad),
            heading_rad=ego.heading_rad + travelled_m * sin(control.steering_rad) / ego.length_m,
            speed_mps=max(ego.speed_mps + self._acceleration * self.dt_s, 0.0),
        )
        actors = range(len(self._situation.actors))
        return moved, tuple(self._situation.move_actor(i, step, moved) for i in actors)


def disturbed(truth: Observation, by: Sequence[float]) -> tuple[int, Others]:
    """Which vehicle is nearest, and the others as the planner sees them [m]."""
    ways_m = [hypot(one.x_m - truth.ego.x_m, one.y_m - truth.ego.y_m) for one in truth.others]
    nearest = ways_m.index(min(ways_m))
    seen, actor = list(truth.others), truth.others[nearest]
    seen[nearest] = replace(actor, x_m=actor.x_m + by[0], y_m=actor.y_m + by[1])
    return nearest, tuple(seen)


def overlap(one: VehicleState, other: VehicleState) -> bool:
    """Whether two footprints touch; on a straight road their headings make no difference."""
    along_m, across_m = abs(one.x_m - other.x_m), abs(one.y_m - other.y_m)
    is_level = 2.0 * along_m < one.length_m + other.length_m
    return is_level and 2.0 * across_m < one.width_m + other.width_m


class LaggingBrakes:
    """The simulator (contract `Simulator`): opens simulations, and holds nothing itself."""

    channels = frozenset(AXES)

    def open(
        self, scenario: Scenario, parameters: Any, planner: Planner, channels: tuple[Channel, ...]
    ) -> Simulation:
        """A simulation of the planner in the scenario, with some of its channels in any order."""
        places = {channel.name: place for place, channel in enumerate(channels)}
        return LaggingSimulation(scenario, parameters, planner, places)
