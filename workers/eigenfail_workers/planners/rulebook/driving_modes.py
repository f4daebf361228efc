"""Driving modes: departure, highway, arrival; each with its own target speed and vigour."""

from collections.abc import Callable
from enum import StrEnum
from math import sqrt
from typing import Annotated

import msgspec
from msgspec import Meta

from eigenfail.values import Mission, VehicleState

Speed = Annotated[float, Meta(gt=0.0, le=40.0)]
Acceleration = Annotated[float, Meta(gt=0.0, le=5.0)]


class ModeSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How the modes drive.

    Attributes:
        departed_mps: speed at which a departure has become driving on the highway.
        departure_acceleration_mps2: a loaded truck pulls away gently.
        highway_acceleration_mps2: what is left of its power at speed.
        arrival_deceleration_mps2: with which it comes to rest at its goal.
        arrival_margin_m: how long before that it begins.
        arrival_lead_s: the speed follows its target with this lag, which an arrival allows for.
    """

    departed_mps: Speed = 15.0
    departure_acceleration_mps2: Acceleration = 0.8
    highway_acceleration_mps2: Acceleration = 0.5
    arrival_deceleration_mps2: Acceleration = 1.0
    arrival_margin_m: Annotated[float, Meta(ge=0.0, le=500.0)] = 30.0
    arrival_lead_s: Annotated[float, Meta(ge=0.0, le=10.0)] = 2.5


class DrivingMode(StrEnum):
    """What the truck is about."""

    DEPARTURE = "departure"
    HIGHWAY = "highway"
    ARRIVAL = "arrival"


class Task(msgspec.Struct, frozen=True, gc=False):
    """What the mode asks for: a speed to reach, and the acceleration allowed for it."""

    target_mps: float
    max_acceleration_mps2: float


class ModeMachine:
    """Which mode the truck is in; arrival is final, and departure is not entered again."""

    def __init__(self, settings: ModeSettings, mission: Mission) -> None:
        self._settings = settings
        self._mission = mission
        self._mode = DrivingMode.DEPARTURE

    def update(self, ego: VehicleState) -> tuple[DrivingMode, Task]:
        """The mode for an ego there, and its task."""
        if self._mode is DrivingMode.DEPARTURE and ego.speed_mps >= self._departed_mps:
            self._mode = DrivingMode.HIGHWAY
        if self._remaining_m(ego) <= self._arrival_m(ego.speed_mps):
            self._mode = DrivingMode.ARRIVAL
        return self._mode, TASKS[self._mode](self, ego)

    @property
    def _departed_mps(self) -> float:
        return min(self._settings.departed_mps, 0.9 * self._cruise_mps)

    @property
    def _cruise_mps(self) -> float:
        return min(self._mission.desired_speed_mps, self._mission.speed_limit_mps)

    def _remaining_m(self, ego: VehicleState) -> float:
        return self._mission.goal_x_m - ego.x_m

    def _arrival_m(self, speed_mps: float) -> float:
        """The way to rest from a speed, and the margin."""
        braking_m = speed_mps**2 / (2.0 * self._settings.arrival_deceleration_mps2)
        return braking_m + self._settings.arrival_margin_m

    def depart(self, _ego: VehicleState) -> Task:
        """Pull away."""
        return Task(self._cruise_mps, self._settings.departure_acceleration_mps2)

    def cruise(self, _ego: VehicleState) -> Task:
        """Keep the desired speed, within the limit."""
        return Task(self._cruise_mps, self._settings.highway_acceleration_mps2)

    def arrive(self, ego: VehicleState) -> Task:
        """Come to rest at the goal: the speed from which that is still possible."""
        way_m = max(self._remaining_m(ego), 0.0)
        settings = self._settings
        braking = settings.arrival_deceleration_mps2
        speed_mps = max(sqrt(2.0 * braking * way_m) - braking * settings.arrival_lead_s, 0.0)
        return Task(min(speed_mps, self._cruise_mps), settings.departure_acceleration_mps2)


TASKS: dict[DrivingMode, Callable[[ModeMachine, VehicleState], Task]] = {
    DrivingMode.DEPARTURE: ModeMachine.depart,
    DrivingMode.HIGHWAY: ModeMachine.cruise,
    DrivingMode.ARRIVAL: ModeMachine.arrive,
}
