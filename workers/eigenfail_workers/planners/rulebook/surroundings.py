"""The others as they matter to the truck: how far, how fast, and whether in its way."""

from collections.abc import Iterable

import msgspec

from eigenfail.values import VehicleState
from eigenfail_workers.planners.rulebook.tracker import Track

TOUCHING_MPS2 = 100.0
"""Stands for the required deceleration where no room is left [m/s²]."""


class Neighbour(msgspec.Struct, frozen=True, gc=False):
    """A trusted vehicle ahead, relative to the truck.

    Attributes:
        gap_m: from the truck's front to its rear bumper.
        aside_m: distance between the two centre lines.
        speed_mps: along the road.
    """

    gap_m: float
    aside_m: float
    speed_mps: float


class Surroundings(msgspec.Struct, frozen=True):
    """Whom the truck must heed.

    Attributes:
        lead: the nearest vehicle that is in the truck's lane or is taken to come into it.
        neighbour: the nearest other vehicle ahead beside the truck's lane.
    """

    lead: Neighbour | None = None
    neighbour: Neighbour | None = None


def look_around(tracks: Iterable[Track], ego: VehicleState, beside_m: float) -> Surroundings:
    """The nearest lead, and the nearest vehicle ahead within `beside_m` that is not the lead."""
    lead: Neighbour | None = None
    neighbour: Neighbour | None = None
    for track in tracks:
        if not track.is_trusted or track.along.position_m <= ego.x_m:
            continue
        other = relative(track, ego)
        if track.leads:
            lead = nearer(other, lead)
        elif other.aside_m < beside_m:
            neighbour = nearer(other, neighbour)
    return Surroundings(lead, neighbour)


def relative(track: Track, ego: VehicleState) -> Neighbour:
    """A track as the truck sees it."""
    return Neighbour(
        gap_m=track.along.position_m - ego.x_m - (ego.length_m + track.seen.length_m) / 2.0,
        aside_m=abs(track.across.position_m - ego.y_m),
        speed_mps=track.along.velocity_mps,
    )


def nearer(one: Neighbour, other: Neighbour | None) -> Neighbour:
    """The nearer of the two."""
    return one if other is None or one.gap_m < other.gap_m else other


def required_deceleration(gap_m: float, closing_mps: float, margin_m: float) -> float:
    """Constant deceleration that ends the closing `margin_m` behind the other [m/s²].

    dv² / (2 · (gap − margin)); 0 while not closing.
    """
    if closing_mps <= 0.0:
        return 0.0
    room_m = gap_m - margin_m
    if room_m <= 0.0:
        return TOUCHING_MPS2
    return min(closing_mps * closing_mps / (2.0 * room_m), TOUCHING_MPS2)
