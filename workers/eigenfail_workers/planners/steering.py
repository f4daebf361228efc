"""Steering along the road: pure pursuit of a lateral position, and of the centre of a lane."""

from math import atan, atan2, sin
from typing import Final

from eigenfail.values.scene import Mission, VehicleState

LOOK_AHEAD_S: Final = 1.5


SHORTEST_LOOK_AHEAD_M: Final = 12.0


MAX_STEERING_RAD: Final = 0.3


class LaneKeeping:
    """Steers to a point ahead on the centre of the episode's first lane."""

    def __init__(self, mission: Mission) -> None:
        self._lane_width_m = mission.lane_width_m
        self._lanes = mission.lanes
        self._centre_m: float | None = None

    def __call__(self, ego: VehicleState) -> float:
        """Return the steering angle for an ego. [rad]"""
        # Chosen once: chosen anew in each step, a disturbed position would make the truck change
        # lanes.
        if self._centre_m is None:
            self._centre_m = self._nearest_centre_m(ego.y_m)
        return pursue(ego, self._centre_m)

    def centre_m(self, ego: VehicleState) -> float:
        """Return the lateral position at which an ego is kept. [m]"""
        return self._nearest_centre_m(ego.y_m) if self._centre_m is None else self._centre_m

    def _nearest_centre_m(self, y_m: float) -> float:
        lane = min(max(round(y_m / self._lane_width_m), 0), self._lanes - 1)
        return lane * self._lane_width_m


def look_ahead_m(ego: VehicleState) -> float:
    """Distance along the road to the pursued point. [m]"""
    return max(ego.speed_mps * LOOK_AHEAD_S, SHORTEST_LOOK_AHEAD_M)


def pursue(ego: VehicleState, aim_y_m: float) -> float:
    """Return the steering angle towards a lateral position one look-ahead away. [rad]

    Coulter, Implementation of the Pure Pursuit Path Tracking Algorithm, CMU-RI-TR-92-01.
    """
    ahead_m = look_ahead_m(ego)
    bearing = atan2(aim_y_m - ego.y_m, ahead_m) - ego.heading_rad
    angle = atan(2.0 * ego.length_m * sin(bearing) / ahead_m)
    return min(max(angle, -MAX_STEERING_RAD), MAX_STEERING_RAD)
