"""Simulator without dependencies: a kinematic bicycle in plain Python."""

from math import atan, cos, sin, tan
from typing import Any

from eigenfail.contracts import Planner, Scenario, Simulation, Situation
from eigenfail.values import Control, VehicleState
from eigenfail_workers.closed_loop import DrivenSimulation, GroundTruth
from eigenfail_workers.measures.geometry import distance_lower_bound, separation


class PointMassWorld:
    """Vehicles as moving footprints; an overlap is a collision. Implements `TrafficWorld`."""

    _situation: Situation
    _ego: VehicleState
    _step: int

    def reset(self, situation: Situation) -> GroundTruth:
        """Place the vehicles of the situation."""
        self._situation = situation
        self._ego = situation.ego
        self._step = 0
        return _truth(situation.ego, situation.actors)

    def advance(self, control: Control) -> GroundTruth:
        """Drive the ego, then place the actors, then test for collisions."""
        self._step += 1
        self._ego = drive(self._ego, control, self._situation.mission.dt_s)
        move = self._situation.move_actor
        actors = range(len(self._situation.actors))
        return _truth(self._ego, tuple(move(i, self._step, self._ego) for i in actors))


def drive(vehicle: VehicleState, control: Control, dt_s: float) -> VehicleState:
    """Return the vehicle one step later: a kinematic bicycle that never drives backwards.

    Its axles are at its ends, and its centre is half-way between them.
    """
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


def _truth(ego: VehicleState, others: tuple[VehicleState, ...]) -> GroundTruth:
    return GroundTruth(ego, others, any(_touch(ego, other) for other in others))


def _touch(ego: VehicleState, other: VehicleState) -> bool:
    return distance_lower_bound(ego, other) <= 0.0 and separation(ego, other).distance_m == 0.0


class PointMassSimulator:
    """Opens simulations that need nothing but this package."""

    def open(self, scenario: Scenario, parameters: Any, planner: Planner) -> Simulation:
        """Return a simulation of the planner in the scenario."""
        return DrivenSimulation(PointMassWorld(), scenario, parameters, planner)
