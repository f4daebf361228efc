"""What a driver foresees: itself behind a lead, and who follows, all others at constant speed."""

from collections.abc import Callable
from math import inf

from eigenfail.values import VehicleState

Model = Callable[[float, float, float], float]
"""The acceleration [m/s²] of who drives at a speed [m/s], a gap [m] behind a lead at a speed."""

STEP_S = 0.5


def least_gap_behind(
    ego: VehicleState,
    lead: VehicleState | None,
    follower: VehicleState,
    model: Model,
    foresight_s: float,
) -> float:
    """The smallest gap [m] between the ego and its follower, from now on.

    The ego follows its lead by its model, in steps of half a second: whoever merges closer than it
    likes falls back later, and who does not react must have the room for it.

    Args:
        ego: who decides.
        lead: whom it will follow; None on a free road.
        follower: who will follow it.
        model: of the ego.
        foresight_s: how far ahead to look.
    """
    gap = least = gap_m(follower, ego)
    room = inf if lead is None else gap_m(ego, lead)
    speed = ego.speed_mps
    pace = speed if lead is None else lead.speed_mps
    for _ in range(round(foresight_s / STEP_S)):
        speed = max(speed + model(speed, room, pace) * STEP_S, 0.0)
        gap += (speed - follower.speed_mps) * STEP_S
        room += (pace - speed) * STEP_S
        least = min(least, gap)
    return least


def gap_m(rear: VehicleState, front: VehicleState) -> float:
    """From one's front to another's rear bumper along the road [m]."""
    return front.x_m - rear.x_m - (rear.length_m + front.length_m) / 2.0
