"""The others as they matter to the truck: how far, how fast, and whether in its way."""

from collections.abc import Collection, Iterable, Mapping

import msgspec

from eigenfail.values import VehicleState
from eigenfail_workers.planners.rulebook.tracker import Track

TOUCHING_MPS2 = 100.0
"""Stands for the required deceleration where no room is left [m/s²]."""


LEAD_BRAKING_MPS2 = 4.0
"""How hard somebody is taken to brake whose brake lights are on [m/s²]."""


class Neighbour(msgspec.Struct, frozen=True, gc=False):
    """A trusted vehicle ahead, relative to the truck.

    Attributes:
        gap_m: from the truck's front to its rear bumper.
        aside_m: distance between the two centre lines.
        speed_mps: along the road.
        is_braking: whether its brake lights are on.
    """

    gap_m: float
    aside_m: float
    speed_mps: float
    is_braking: bool = False


class Gap(msgspec.Struct, frozen=True, gc=False):
    """Room between two vehicles of the next lane; None where nobody bounds it.

    Attributes:
        ahead: relative to the truck's front bumper; beside it, its gap is negative.
        behind: its gap is from the truck's rear bumper back to its front bumper.
    """

    ahead: Neighbour | None = None
    behind: Neighbour | None = None


class Surroundings(msgspec.Struct, frozen=True):
    """Whom and what the truck must heed.

    Attributes:
        lead: the nearest vehicle that is in the truck's lane or is taken to come into it.
        neighbour: the nearest other vehicle ahead beside the truck's lane.
        lane_end: the end of the truck's lane, as if somebody stood there.
        gaps: those of the next lane, by the name of the candidate that makes for them.
    """

    lead: Neighbour | None = None
    neighbour: Neighbour | None = None
    lane_end: Neighbour | None = None
    gaps: Mapping[str, Gap] = {}


def look_around(
    tracks: Iterable[Track],
    ego: VehicleState,
    beside_m: float,
    braking: Collection[Track] = frozenset(),
) -> Surroundings:
    """The nearest lead, and the nearest vehicle ahead within `beside_m` that is not the lead."""
    lead: Neighbour | None = None
    neighbour: Neighbour | None = None
    for track in tracks:
        if not track.is_trusted or track.along.position_m <= ego.x_m:
            continue
        other = relative(track, ego, track in braking)
        if track.leads:
            lead = nearer(other, lead)
        elif other.aside_m < beside_m:
            neighbour = nearer(other, neighbour)
    return Surroundings(lead, neighbour)


def relative(track: Track, ego: VehicleState, is_braking: bool = False) -> Neighbour:
    """A track as the truck sees it."""
    return Neighbour(
        gap_m=track.along.position_m - ego.x_m - (ego.length_m + track.seen.length_m) / 2.0,
        aside_m=abs(track.across.position_m - ego.y_m),
        speed_mps=track.along.velocity_mps,
        is_braking=is_braking,
    )


def relative_behind(track: Track, ego: VehicleState) -> Neighbour:
    """A track behind the truck: its gap is from the truck's rear to its front bumper."""
    return Neighbour(
        gap_m=ego.x_m - track.along.position_m - (ego.length_m + track.seen.length_m) / 2.0,
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


def needed_deceleration(other: Neighbour, gap_m: float, speed_mps: float, margin_m: float) -> float:
    """Deceleration that keeps the margin behind somebody at that gap [m/s²].

    Who brakes is taken to come to a stop: from its stopping way on, the truck has to stop, too
    (the longitudinal safe distance of Shalev-Shwartz et al., On a formal model of safe and scalable
    self-driving cars, 2017, definition 1, with no response time).
    """
    need = required_deceleration(gap_m, speed_mps - other.speed_mps, margin_m)
    if not other.is_braking:
        return need
    stopping_m = max(other.speed_mps, 0.0) ** 2 / (2.0 * LEAD_BRAKING_MPS2)
    return max(need, required_deceleration(gap_m + stopping_m, speed_mps, margin_m))
