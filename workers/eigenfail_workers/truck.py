"""What the truck can do of what a planner asks for."""

from math import pi

from eigenfail.values import Control
from eigenfail.values.assessment import PEAK_BRAKING_MPS2

MASS_KG = 30_000.0  # a partly loaded articulated truck of the 40 t class
POWER_W = 400_000.0  # about 540 hp, the upper end of long-haul engines
MAX_DRIVE_MPS2 = 1.5  # in the lowest gears, where traction and not power is the limit
MAX_STEERING_RAD = pi / 4  # of the front wheels


def within_limits(control: Control, speed_mps: float) -> Control:
    """The control that acts on the truck: the one asked for, clipped.

    Brakes give 7.0 m/s² at most (the paper's peak braking). The engine gives a ≤ P / (m · v), on a
    level road without drag, and no more than MAX_DRIVE_MPS2.
    """
    drive_mps2 = strongest_drive(speed_mps)
    return Control(
        min(max(control.acceleration_mps2, -PEAK_BRAKING_MPS2), drive_mps2),
        min(max(control.steering_rad, -MAX_STEERING_RAD), MAX_STEERING_RAD),
    )


def strongest_drive(speed_mps: float) -> float:
    """The largest acceleration at a speed. [m/s²]"""
    if speed_mps * MAX_DRIVE_MPS2 * MASS_KG <= POWER_W:
        return MAX_DRIVE_MPS2
    return POWER_W / (MASS_KG * speed_mps)
