"""Simulator with the physics of highway-env: its kinematic bicycle, and overlaps as collisions.

highway-env's vehicles are numpy arrays for crowded roads, with a search for lanes in every step.
For a truck and the few vehicles around it, plain floats take a tenth of that time. The numbers are
the same: tests compare this module with highway-env's own classes, to the last bit.
"""

from math import cos, sin
from typing import Any, ClassVar, Final

import numpy as np

from eigenfail.contracts import Planner, Scenario, Simulation
from eigenfail.values.channels import ALL_CHANNELS, Channel
from eigenfail.values.scene import Control, VehicleState
from eigenfail_workers.closed_loop import DrivenSimulation
from eigenfail_workers.perception import SensorErrors
from eigenfail_workers.simulators.scripted_world import ScriptedWorld

MAX_SPEED_MPS: Final = 40.0
"""highway-env's `Vehicle.MAX_SPEED`: a faster vehicle is slowed down to it."""


def drive(vehicle: VehicleState, control: Control, dt_s: float) -> VehicleState:
    """Return the vehicle one step later, as highway-env's `Vehicle.step` moves it.

    Braking ends at rest. highway-env uses numpy's tangent and arctangent. Unlike sine and cosine,
    they differ from the C library in the last bit on some processors.
    """
    speed = vehicle.speed_mps
    slip = float(np.arctan(0.5 * np.tan(control.steering_rad)))
    course = vehicle.heading_rad + slip
    acceleration = control.acceleration_mps2
    if speed > MAX_SPEED_MPS:
        acceleration = min(acceleration, MAX_SPEED_MPS - speed)
    return VehicleState(
        # The factors stand in highway-env's order: another order differs in the last bit.
        vehicle.x_m + speed * cos(course) * dt_s,
        vehicle.y_m + speed * sin(course) * dt_s,
        vehicle.heading_rad + speed * sin(slip) / (0.5 * vehicle.length_m) * dt_s,
        max(speed + acceleration * dt_s, 0.0),
        vehicle.length_m,
        vehicle.width_m,
    )


class HighwaySimulator:
    """Opens simulations with the physics of highway-env."""

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
