"""Surrogate safety measures: time to collision and deceleration required to avoid the crash.

Definitions of FHWA-RD-03-050 (Surrogate Safety Measures from Traffic Simulation Models), taken from
one lane to the plane: the gap is the distance between the footprints, and the closing speed is the
relative velocity along the line of nearest points.
"""

from typing import Final

from eigenfail.values import VehicleState
from eigenfail_workers.measures.geometry import half_width_across_road, velocity
from eigenfail_workers.values import Separation, TrafficConflict

LOOK_AHEAD_S: Final = 1.0
"""A vehicle enters the path if its footprint will overlap the ego's laterally within this time."""


def find_conflict(
    ego: VehicleState, other: VehicleState, between: Separation
) -> TrafficConflict | None:
    """Return the conflict of the ego with another vehicle, or None.

    A conflict exists while the gap is positive and shrinks, and the other vehicle is in the ego's
    path or entering it. At contact there is no conflict: DRAC tends to infinity there, so that its
    largest value is that of the last step before the contact.
    """
    if between.distance_m == 0.0 or not shares_path(ego, other):
        return None
    vx, vy = velocity(ego)
    other_vx, other_vy = velocity(other)
    nx, ny = between.direction
    closing = (vx - other_vx) * nx + (vy - other_vy) * ny
    if closing <= 0.0:
        return None
    return TrafficConflict(between.distance_m / closing, closing**2 / (2.0 * between.distance_m))


def shares_path(ego: VehicleState, other: VehicleState) -> bool:
    """Whether the footprints overlap laterally, now or within LOOK_AHEAD_S.

    Lateral is across the road; the lateral velocities are assumed constant.
    """
    offset = other.y_m - ego.y_m
    gap = abs(offset) - half_width_across_road(ego) - half_width_across_road(other)
    drift = velocity(other)[1] - velocity(ego)[1]
    approach = -drift if offset > 0.0 else drift
    return gap <= max(approach, 0.0) * LOOK_AHEAD_S
