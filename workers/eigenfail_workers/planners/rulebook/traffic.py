"""Traffic relative to the truck: its lead, its neighbour, and the gaps of the next lane."""

from collections.abc import Collection, Iterable, Sequence
from typing import Final

from eigenfail.values.scene import VehicleState
from eigenfail_workers.planners.rulebook.settings import GapSettings
from eigenfail_workers.planners.rulebook.tracker import Track
from eigenfail_workers.planners.rulebook.values import Gap, Neighbour, Traffic

TOUCHING_MPS2: Final = 100.0
"""Required deceleration where no room is left. [m/s²]"""

LEAD_BRAKING_MPS2: Final = 4.0
"""Assumed deceleration of a vehicle with brake lights on. [m/s²]"""


def find_traffic(
    tracks: Iterable[Track],
    ego: VehicleState,
    beside_m: float,
    braking: Collection[Track] = frozenset(),
) -> Traffic:
    """Return the traffic of the trusted tracks.

    Args:
        tracks: tracks of all vehicles.
        ego: the truck.
        beside_m: lateral distance beyond which a vehicle is not a neighbour.
        braking: tracks of vehicles with brake lights on.
    """
    lead: Neighbour | None = None
    neighbour: Neighbour | None = None
    for track in tracks:
        # A tentative track may be noise: to brake for it would be a phantom.
        if not track.is_trusted or track.along.position_m <= ego.x_m:
            continue
        other = make_neighbour_ahead(track, ego, track in braking)
        if track.leads:
            lead = find_nearer(other, lead)
        elif other.aside_m < beside_m:
            neighbour = find_nearer(other, neighbour)
    return Traffic(lead, neighbour)


def make_neighbour_ahead(track: Track, ego: VehicleState, is_braking: bool = False) -> Neighbour:
    """Return a track ahead, relative to the truck."""
    return Neighbour(
        gap_m=track.along.position_m - ego.x_m - (ego.length_m + track.seen.length_m) / 2.0,
        aside_m=abs(track.across.position_m - ego.y_m),
        speed_mps=track.along.velocity_mps,
        is_braking=is_braking,
        number=track.number,
    )


def make_neighbour_behind(track: Track, ego: VehicleState) -> Neighbour:
    """Return a track behind, relative to the truck."""
    return Neighbour(
        gap_m=ego.x_m - track.along.position_m - (ego.length_m + track.seen.length_m) / 2.0,
        aside_m=abs(track.across.position_m - ego.y_m),
        speed_mps=track.along.velocity_mps,
    )


def find_nearer(one: Neighbour, other: Neighbour | None) -> Neighbour:
    """Return the neighbour with the smaller gap."""
    return one if other is None or one.gap_m < other.gap_m else other


def required_deceleration(gap_m: float, closing_mps: float, margin_m: float) -> float:
    """Constant deceleration that ends the closing at a gap of `margin_m`. [m/s²]

    dv² / (2 · (gap − margin)); 0 while not closing.
    """
    if closing_mps <= 0.0:
        return 0.0
    room_m = gap_m - margin_m
    if room_m <= 0.0:
        return TOUCHING_MPS2
    return min(closing_mps * closing_mps / (2.0 * room_m), TOUCHING_MPS2)


def needed_deceleration(other: Neighbour, gap_m: float, speed_mps: float, margin_m: float) -> float:
    """Deceleration that keeps the margin behind a vehicle at a gap. [m/s²]

    A vehicle that brakes is assumed to come to a stop: the truck must stop behind that point, too.
    This is the longitudinal safe distance of Shalev-Shwartz et al., On a formal model of safe and
    scalable self-driving cars, 2017, definition 1, with no response time.
    """
    need = required_deceleration(gap_m, speed_mps - other.speed_mps, margin_m)
    if not other.is_braking:
        return need
    stopping_m = max(other.speed_mps, 0.0) ** 2 / (2.0 * LEAD_BRAKING_MPS2)
    return max(need, required_deceleration(gap_m + stopping_m, speed_mps, margin_m))


CHANGE_LANE = "change_lane"
MERGE_EARLY = "merge_early"
MERGE_LATE = "merge_late"

Tracks = Sequence[Track]
Bounds = tuple[Tracks, Tracks]
"""Tracks ahead and tracks behind, nearest first."""


class GapFinder:
    """Finds the gaps of the lane with its centre at a lateral position.

    Tracks that are not trusted yet count, too: a gap that may hold a vehicle is not free.
    """

    def __init__(
        self, settings: GapSettings, centre_m: float, lane_width_m: float, dt_s: float
    ) -> None:
        self._settings = settings
        self._centre_m = centre_m
        self._half_width_m = 0.5 * lane_width_m
        self._youngest = settings.youngest_s / dt_s

    def find_gaps(self, tracks: Iterable[Track], ego: VehicleState) -> dict[str, Gap]:
        """Return the gaps that may be entered, without gaps bounded by young tracks.

        If a vehicle is alongside or close behind, these are the gap ahead of it and the gap after
        it. Otherwise, it is only the gap alongside the truck.
        """
        ahead, behind = self._split(tracks, ego)
        # Its centre is ahead, but its rear is not: it is beside the truck, and bounds both gaps.
        if ahead and make_neighbour_ahead(ahead[0], ego).gap_m <= 0.0:
            passing, *ahead = ahead
            behind = [passing, *behind]
        elif not (
            behind and make_neighbour_behind(behind[0], ego).gap_m < self._settings.clear_behind_m
        ):
            return self._make_gaps({CHANGE_LANE: (ahead, behind)}, ego)
        return self._make_gaps(
            {MERGE_EARLY: (ahead, behind), MERGE_LATE: (behind, behind[1:])}, ego
        )

    def _make_gaps(self, gaps: dict[str, Bounds], ego: VehicleState) -> dict[str, Gap]:
        return {
            name: self._between(ahead, behind, ego)
            for name, (ahead, behind) in gaps.items()
            if all(self._is_known(bound) for bound in (*ahead[:1], *behind[:1]))
        }

    def _is_known(self, track: Track) -> bool:
        return track.is_trusted and track.age >= self._youngest

    def find_beside(self, tracks: Iterable[Track], ego: VehicleState) -> Gap:
        """Return the gap next to the truck's centre."""
        return self._between(*self._split(tracks, ego), ego)

    def _split(self, tracks: Iterable[Track], ego: VehicleState) -> Bounds:
        """Return the tracks of the lane ahead of the truck's centre and behind, nearest first."""
        there = [
            one
            for one in tracks
            if abs(one.across.position_m - self._centre_m) < self._half_width_m
        ]
        # Sorted here: the order of the tracks is that of their birth.
        there.sort(key=lambda one: one.along.position_m)
        ahead = [one for one in there if one.along.position_m > ego.x_m]
        return ahead, [one for one in reversed(there) if one.along.position_m <= ego.x_m]

    def _between(self, ahead: Tracks, behind: Tracks, ego: VehicleState) -> Gap:
        return Gap(
            ahead=make_neighbour_ahead(ahead[0], ego) if ahead else None,
            behind=make_neighbour_behind(behind[0], ego) if behind else None,
        )
