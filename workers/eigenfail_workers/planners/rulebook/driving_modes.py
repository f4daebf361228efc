"""Driving modes: departure, highway and arrival, each with a target speed and acceleration."""

from collections.abc import Callable
from math import sqrt

from eigenfail.values.scene import Mission, VehicleState
from eigenfail_workers.planners.rulebook.settings import ModeSettings
from eigenfail_workers.planners.rulebook.values import DrivingMode, Task


class ModeMachine:
    """State machine of the modes: departure, then highway, then arrival."""

    def __init__(self, settings: ModeSettings, mission: Mission) -> None:
        self._settings = settings
        self._mission = mission
        self._mode = DrivingMode.DEPARTURE

    def update(self, ego: VehicleState) -> tuple[DrivingMode, Task]:
        """Return the mode of an ego, and its task."""
        settings = self._settings
        departed_mps = min(settings.departed_mps, 0.9 * self._cruise_mps)
        if self._mode is DrivingMode.DEPARTURE and ego.speed_mps >= departed_mps:
            self._mode = DrivingMode.HIGHWAY
        braking_m = ego.speed_mps**2 / (2.0 * settings.arrival_deceleration_mps2)
        # After the departure: a goal that is near at the start is an arrival from the first step
        # on.
        if self._remaining_m(ego) <= braking_m + settings.arrival_margin_m:
            self._mode = DrivingMode.ARRIVAL
        return self._mode, TASKS[self._mode](self, ego)

    @property
    def _cruise_mps(self) -> float:
        return min(self._mission.desired_speed_mps, self._mission.speed_limit_mps)

    def _remaining_m(self, ego: VehicleState) -> float:
        return self._mission.goal_x_m - ego.x_m

    def depart(self, _ego: VehicleState) -> Task:
        """Return the task of a departure."""
        return Task(self._cruise_mps, self._settings.departure_acceleration_mps2)

    def cruise(self, _ego: VehicleState) -> Task:
        """Return the task on the highway: the desired speed, within the limit."""
        return Task(self._cruise_mps, self._settings.highway_acceleration_mps2)

    def arrive(self, ego: VehicleState) -> Task:
        """Return the task of an arrival: a speed that still allows a stop at the goal."""
        way_m = max(self._remaining_m(ego), 0.0)
        settings = self._settings
        braking = settings.arrival_deceleration_mps2
        # v = sqrt(2 b s) stops at the goal. The truck lags behind its target: it gets the target of
        # a moment later.
        speed_mps = max(sqrt(2.0 * braking * way_m) - braking * settings.arrival_lead_s, 0.0)
        return Task(min(speed_mps, self._cruise_mps), settings.departure_acceleration_mps2)


TASKS: dict[DrivingMode, Callable[[ModeMachine, VehicleState], Task]] = {
    DrivingMode.DEPARTURE: ModeMachine.depart,
    DrivingMode.HIGHWAY: ModeMachine.cruise,
    DrivingMode.ARRIVAL: ModeMachine.arrive,
}
