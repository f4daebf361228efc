"""From perceived positions to tracks: constant-velocity Kalman filters with a gate.

The gate and the life of a track are this planner's one weakness. Measurements that do not fit are
thrown away; a track that is thrown off often enough in a row is given up; and what reappears after
that is taken for traffic which flows with the truck. White noise does not get that far.
"""

from enum import StrEnum
from math import isfinite
from typing import Annotated

import msgspec
from msgspec import Meta

from eigenfail.values import Perception, VehicleState
from eigenfail_workers.planners.rulebook.kalman import AxisFilter

Positive = Annotated[float, Meta(gt=0.0, le=100.0)]
Count = Annotated[int, Meta(ge=1, le=100)]


class TrackerSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How perceived positions become tracks.

    Attributes:
        range_slope: the sensor's specification sigma_x = range_slope · |dx| + range_base_m.
        range_base_m: see there. [m]
        lateral_slope: the sensor's specification sigma_y = lateral_slope · |dy| + lateral_base_m.
        lateral_base_m: see there. [m]
        range_acceleration_mps2: standard deviation of the others' acceleration along the road.
        lateral_acceleration_mps2: and across it.
        gate: largest accepted sum of both squared innovations over their variances; chi-square
            with two degrees of freedom, 9.21 for 99 %.
        misses_to_delete: rejected measurements in a row that end a confirmed track.
        hits_to_confirm: accepted measurements that confirm a tentative track.
        tentative_misses: rejected measurements that end a tentative track.
        first_speed_sd_mps: uncertainty of the speed at first sight, around the truck's own.
        again_speed_sd_mps: the same for what reappears after its track was lost.
        lateral_speed_sd_mps: uncertainty of the lateral speed of a new track, around 0.
    """

    range_slope: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.02
    range_base_m: Positive = 1.0
    lateral_slope: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.00625
    lateral_base_m: Positive = 0.2
    range_acceleration_mps2: Positive = 0.3
    lateral_acceleration_mps2: Positive = 0.15
    gate: Positive = 9.21
    misses_to_delete: Count = 8
    hits_to_confirm: Count = 5
    tentative_misses: Count = 2
    first_speed_sd_mps: Positive = 8.0
    again_speed_sd_mps: Positive = 1.75
    lateral_speed_sd_mps: Positive = 1.0


class TrackState(StrEnum):
    """Where a track is in its life."""

    TENTATIVE = "tentative"
    CONFIRMED = "confirmed"
    COASTING = "coasting"
    DELETED = "deleted"


class Track:
    """One vehicle as the planner believes it to be.

    Attributes:
        along: filter along the road; across: filter across it.
        seen: the last perceived vehicle, for its size.
        evidence: how much speaks for its coming into the truck's lane; see `intent`.
        leads: whether it is taken for the truck's lead.
    """

    __slots__ = ("across", "age", "along", "evidence", "hits", "leads", "misses", "seen", "state")

    def __init__(self, along: AxisFilter, across: AxisFilter, seen: VehicleState) -> None:
        self.along = along
        self.across = across
        self.seen = seen
        self.state = TrackState.TENTATIVE
        self.age = 0
        self.hits = 1
        self.misses = 0
        self.evidence = 0
        self.leads = False

    @property
    def is_trusted(self) -> bool:
        """Whether the planner may act on it."""
        return self.state is TrackState.CONFIRMED or self.state is TrackState.COASTING


class Tracker:
    """Keeps one track for each perceived vehicle; the sensor lists them in a stable order.

    Attributes:
        lost: how many trusted tracks were given up since the start of the episode.
    """

    def __init__(self, settings: TrackerSettings, dt_s: float) -> None:
        self._settings = settings
        self._dt_s = dt_s
        self._tracks: dict[int, Track] = {}
        self._known: set[int] = set()
        self.lost = 0

    def update(self, perception: Perception) -> list[Track]:
        """Take one perception in; the tracks that live after it, tentative ones among them."""
        ego = perception.ego
        for slot, seen in enumerate(perception.others):
            track = self._tracks.get(slot)
            if track is not None:
                self._follow(track, seen, ego)
                self._settle(slot, track)
            elif isfinite(seen.x_m) and isfinite(seen.y_m):
                self._tracks[slot] = self._born(seen, ego, slot in self._known)
        return list(self._tracks.values())

    def _born(self, seen: VehicleState, ego: VehicleState, again: bool) -> Track:
        settings = self._settings
        sd_mps = settings.again_speed_sd_mps if again else settings.first_speed_sd_mps
        along_sd, across_sd = self._sensor(seen.x_m - ego.x_m, seen.y_m - ego.y_m)
        along = AxisFilter(seen.x_m, ego.speed_mps, along_sd, sd_mps)
        across = AxisFilter(seen.y_m, 0.0, across_sd, settings.lateral_speed_sd_mps)
        return Track(along, across, seen)

    def _sensor(self, dx_m: float, dy_m: float) -> tuple[float, float]:
        """The sensor's specified standard deviations at a distance [m]."""
        settings = self._settings
        return (
            settings.range_slope * abs(dx_m) + settings.range_base_m,
            settings.lateral_slope * abs(dy_m) + settings.lateral_base_m,
        )

    def _follow(self, track: Track, seen: VehicleState, ego: VehicleState) -> None:
        """Predict; correct with the measurement if it passes the gate; count."""
        settings, along, across = self._settings, track.along, track.across
        along.predict(self._dt_s, settings.range_acceleration_mps2)
        across.predict(self._dt_s, settings.lateral_acceleration_mps2)
        sd_x, sd_y = self._sensor(along.position_m - ego.x_m, across.position_m - ego.y_m)
        var_x, var_y = sd_x * sd_x, sd_y * sd_y
        track.age += 1
        surprise = along.surprise(seen.x_m, var_x) + across.surprise(seen.y_m, var_y)
        # Asked this way round, a NaN is a miss.
        if not surprise <= settings.gate:
            track.misses += 1
            return
        along.correct(seen.x_m, var_x)
        across.correct(seen.y_m, var_y)
        track.seen = seen
        track.hits += 1
        track.misses = 0

    def _settle(self, slot: int, track: Track) -> None:
        """Move the track on in its life."""
        track.state = LIFE[track.state](track, self._settings)
        if track.is_trusted:
            self._known.add(slot)
        if track.state is TrackState.DELETED:
            del self._tracks[slot]
            self.lost += track.hits >= self._settings.hits_to_confirm


def _after_tentative(track: Track, settings: TrackerSettings) -> TrackState:
    if track.misses >= settings.tentative_misses:
        return TrackState.DELETED
    return TrackState.CONFIRMED if track.hits >= settings.hits_to_confirm else TrackState.TENTATIVE


def _after_confirmed(track: Track, settings: TrackerSettings) -> TrackState:
    if track.misses >= settings.misses_to_delete:
        return TrackState.DELETED
    return TrackState.COASTING if track.misses else TrackState.CONFIRMED


LIFE = {
    TrackState.TENTATIVE: _after_tentative,
    TrackState.CONFIRMED: _after_confirmed,
    TrackState.COASTING: _after_confirmed,
}
