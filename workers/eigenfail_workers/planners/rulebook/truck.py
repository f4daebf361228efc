"""The truck's own limits."""

from typing import Annotated

import msgspec
from msgspec import Meta


class TruckLimits(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What the truck can and may do.

    Attributes:
        peak_braking_mps2: of an emergency stop.
        comfort_braking_mps2: hardest braking that is planned.
        comfort_jerk_mps3: change of the planned acceleration.
        emergency_jerk_mps3: change of the acceleration in an emergency.
    """

    peak_braking_mps2: Annotated[float, Meta(gt=0.0, le=10.0)] = 7.0
    comfort_braking_mps2: Annotated[float, Meta(gt=0.0, le=7.0)] = 4.0
    comfort_jerk_mps3: Annotated[float, Meta(gt=0.0, le=20.0)] = 4.0
    emergency_jerk_mps3: Annotated[float, Meta(gt=0.0, le=50.0)] = 15.0


def towards(wanted: float, now: float, largest_change: float) -> float:
    """`wanted`, but no farther from `now` than the largest change."""
    return min(max(wanted, now - largest_change), now + largest_change)
