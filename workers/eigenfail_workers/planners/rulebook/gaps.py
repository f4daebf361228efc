"""The gaps of the next lane, named by what the truck would do to get into them."""

from collections.abc import Iterable, Sequence
from typing import Annotated

import msgspec
from msgspec import Meta

from eigenfail.values import VehicleState
from eigenfail_workers.planners.rulebook.surroundings import (
    Gap,
    relative,
    relative_behind,
)
from eigenfail_workers.planners.rulebook.tracker import Track

CHANGE_LANE = "change_lane"
MERGE_EARLY = "merge_early"
MERGE_LATE = "merge_late"


Tracks = Sequence[Track]
Bounds = tuple[Tracks, Tracks]
"""Those ahead and those behind, nearest first."""


class GapSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How gaps are seen.

    Attributes:
        youngest_s: nobody enters a gap that somebody bounds who was seen for less than this.
        clear_behind_m: who is farther behind than this is no reason to speak of a gap.
    """

    youngest_s: Annotated[float, Meta(ge=0.0, le=10.0)] = 1.5
    clear_behind_m: Annotated[float, Meta(ge=0.0, le=500.0)] = 80.0


class GapFinder:
    """Looks across to a lane with its centre at a lateral position.

    Vehicles that are not trusted yet count, too: a gap that somebody may be in is none.
    """

    def __init__(
        self, settings: GapSettings, centre_m: float, lane_width_m: float, dt_s: float
    ) -> None:
        self._settings = settings
        self._centre_m = centre_m
        self._half_width_m = 0.5 * lane_width_m
        self._youngest = settings.youngest_s / dt_s

    def options(self, tracks: Iterable[Track], ego: VehicleState) -> dict[str, Gap]:
        """The gaps that can be made for; none that is bounded by who is not known well enough.

        Beside or behind somebody: ahead of them, or after them. Otherwise just the one beside.
        """
        ahead, behind = self._split(tracks, ego)
        if ahead and relative(ahead[0], ego).gap_m <= 0.0:
            passing, *ahead = ahead
            behind = [passing, *behind]
        elif not (behind and self._is_near(behind[0], ego)):
            return self._known({CHANGE_LANE: (ahead, behind)}, ego)
        return self._known({MERGE_EARLY: (ahead, behind), MERGE_LATE: (behind, behind[1:])}, ego)

    def _known(self, gaps: dict[str, Bounds], ego: VehicleState) -> dict[str, Gap]:
        return {
            name: self._between(ahead, behind, ego)
            for name, (ahead, behind) in gaps.items()
            if all(self._is_known(bound) for bound in (*ahead[:1], *behind[:1]))
        }

    def _is_known(self, track: Track) -> bool:
        return track.is_trusted and track.age >= self._youngest

    def beside(self, tracks: Iterable[Track], ego: VehicleState) -> Gap:
        """The gap that the truck's centre is in."""
        return self._between(*self._split(tracks, ego), ego)

    def _split(self, tracks: Iterable[Track], ego: VehicleState) -> Bounds:
        """Those of the lane ahead of the truck's centre and those behind it, nearest first."""
        there = [one for one in tracks if self._is_in_lane(one)]
        there.sort(key=lambda one: one.along.position_m)
        ahead = [one for one in there if one.along.position_m > ego.x_m]
        behind = [one for one in reversed(there) if one.along.position_m <= ego.x_m]
        return ahead, behind

    def _is_in_lane(self, track: Track) -> bool:
        return abs(track.across.position_m - self._centre_m) < self._half_width_m

    def _is_near(self, track: Track, ego: VehicleState) -> bool:
        return relative_behind(track, ego).gap_m < self._settings.clear_behind_m

    def _between(self, ahead: Tracks, behind: Tracks, ego: VehicleState) -> Gap:
        return Gap(
            ahead=relative(ahead[0], ego) if ahead else None,
            behind=relative_behind(behind[0], ego) if behind else None,
        )
