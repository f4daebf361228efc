"""The dependency-free twin: the same situations on a kinematic bicycle in plain Python."""

from math import atan, cos, sin, tan
from typing import Any

from eigenfail.contracts import Planner, Scenario, Simulation, Situation
from eigenfail.values import Control, VehicleState
from eigenfail_workers.closed_loop import DrivenSimulation, Truth
from eigenfail_workers.measures.geometry import at_least, separation


class PointMassWorld:
    """Moves the ego's centre; a collision is an overlap of footprints. Implements `World`."""

    _situation: Situation
    _ego: VehicleState
    _step: int

    def reset(self, situation: Situation) -> Truth:
        """Stage the situation."""
        self._situation = situation
        self._ego = situation.ego
        self._step = 0
        return _truth(situation.ego, situation.actors)

    def advance(self, control: Control) -> Truth:
        """Drive the ego, then place the actors, then test for collisions."""
        self._step += 1
        self._ego = drive(self._ego, control, self._situation.mission.dt_s)
        move = self._situation.move_actor
        actors = range(len(self._situation.actors))
        return _truth(self._ego, tuple(move(i, self._step, self._ego) for i in actors))


def drive(vehicle: VehicleState, control: Control, dt_s: float) -> VehicleState:
    """A kinematic bicycle with its centre half-way between axles at its ends; never backwards."""
    slip = atan(0.5 * tan(control.steering_rad))
    course = vehicle.heading_rad + slip
    travelled = vehicle.speed_mps * dt_s
    return VehicleState(
        vehicle.x_m + travelled * cos(course),
        vehicle.y_m + travelled * sin(course),
        vehicle.heading_rad + travelled * sin(slip) / (0.5 * vehicle.length_m),
        max(vehicle.speed_mps + control.acceleration_mps2 * dt_s, 0.0),
        vehicle.length_m,
        vehicle.width_m,
    )


def _truth(ego: VehicleState, others: tuple[VehicleState, ...]) -> Truth:
    return Truth(ego, others, any(_touch(ego, other) for other in others))


def _touch(ego: VehicleState, other: VehicleState) -> bool:
    return at_least(ego, other) <= 0.0 and separation(ego, other).distance_m == 0.0


class PointMassSimulator:
    """Opens simulations that need nothing but this package."""

    def open(self, scenario: Scenario, parameters: Any, planner: Planner) -> Simulation:
        """A simulation of the planner in the scenario."""
        return DrivenSimulation(PointMassWorld(), scenario, parameters, planner)
