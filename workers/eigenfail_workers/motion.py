"""The motion of vehicles: limits of the truck, the road's borders, and the path of least jerk."""

from math import pi
from typing import Final

from eigenfail.values.scene import Control, LanePosition, Mission, VehicleState

MASS_KG: Final = 30_000.0  # a partly loaded articulated truck of the 40 t class
POWER_W: Final = 400_000.0  # about 540 hp, the upper end of long-haul engines
MAX_DRIVE_MPS2: Final = 1.5  # in the lowest gears, where traction and not power is the limit
MAX_STEERING_RAD: Final = pi / 4  # of the front wheels


def clip_control(control: Control, speed_mps: float, peak_braking_mps2: float) -> Control:
    """Return the control that acts on the truck: the requested one, clipped to its limits.

    Brakes give `peak_braking_mps2` at most. The engine gives a ≤ P / (m · v), on a level road
    without drag, and no more than MAX_DRIVE_MPS2.
    """
    return Control(
        min(max(control.acceleration_mps2, -peak_braking_mps2), max_drive_mps2(speed_mps)),
        min(max(control.steering_rad, -MAX_STEERING_RAD), MAX_STEERING_RAD),
    )


def max_drive_mps2(speed_mps: float) -> float:
    """Largest acceleration of the truck at a speed. [m/s²]"""
    # Compared as products: a division would fail for a truck at rest.
    if speed_mps * MAX_DRIVE_MPS2 * MASS_KG <= POWER_W:
        return MAX_DRIVE_MPS2
    return POWER_W / (MASS_KG * speed_mps)


def is_off_road(mission: Mission, vehicle: VehicleState) -> bool:
    """Return whether a vehicle's centre is outside the lanes or behind the end of its lane.

    Lane n reaches from (n - 1/2) to (n + 1/2) lane widths across the road. Only lane 0 may end;
    beyond its end the road begins at lane 1.
    """
    lane = vehicle.y_m / mission.lane_width_m
    if not -0.5 <= lane <= mission.lanes - 0.5:
        return True
    ends_x_m = mission.lane_0_ends_x_m
    return ends_x_m is not None and lane < 0.5 and vehicle.x_m > ends_x_m


def find_lane(mission: Mission, vehicle: VehicleState) -> LanePosition:
    """Return the position of a vehicle in the lane with the nearest centre.

    Lane 0 does not count beyond its end.
    """
    width_m, ends_x_m = mission.lane_width_m, mission.lane_0_ends_x_m
    first = 1 if ends_x_m is not None and vehicle.x_m > ends_x_m else 0
    lane = min(max(round(vehicle.y_m / width_m), first), mission.lanes - 1)
    return LanePosition(vehicle.y_m - lane * width_m, width_m)


def minimum_jerk(share: float) -> tuple[float, float]:
    """Position and slope of the path of least jerk from 0 to 1, at a share of the way in [0, 1].

    10 s³ − 15 s⁴ + 6 s⁵ (Flash and Hogan, The coordination of arm movements, 1985, eq. 7).
    """
    done = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
    return done, 30.0 * (share * (1.0 - share)) ** 2
