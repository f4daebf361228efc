"""Simulator without dependencies: a kinematic bicycle in plain Python."""

from math import atan, cos, sin, tan
from typing import Any, ClassVar

from eigenfail.contracts import Planner, Scenario, Simulation
from eigenfail.values.channels import ALL_CHANNELS, Channel
from eigenfail.values.scene import Control, VehicleState
from eigenfail_workers.closed_loop import DrivenSimulation
from eigenfail_workers.perception import SensorErrors
from eigenfail_workers.simulators.scripted_world import ScriptedWorld


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


class PointMassSimulator:
    """Opens simulations that need nothing but this package."""

    channels: ClassVar = ALL_CHANNELS
    occludes: ClassVar = True

    def open(
        self,
        scenario: Scenario,
        parameters: Any,
        planner: Planner,
        channels: tuple[Channel, ...],
        occlusion: bool = False,
    ) -> Simulation:
        """Return a simulation of the planner in the scenario."""
        errors = SensorErrors(channels, occlusion)
        return DrivenSimulation(ScriptedWorld(drive), scenario, parameters, planner, errors)
