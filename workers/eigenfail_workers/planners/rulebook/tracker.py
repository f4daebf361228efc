"""Tracks of perceived vehicles: constant-velocity Kalman filters with a gate.

The gate and the life cycle of a track are this planner's one weakness. Measurements outside the
gate are rejected; a track with enough rejections in a row is deleted; and a vehicle that reappears
after that is assumed to drive as fast as the truck. White noise does not cause this.

Brake lights widen the uncertainty of a track: a vehicle that brakes may come to a stop, and its
filter, which assumes nearly constant speed, would soon reject its positions. Lights are on or off:
they contain no deceleration.
"""

from enum import StrEnum
from math import isfinite
from typing import Annotated

import msgspec
from msgspec import Meta

from eigenfail.values import Perception, VehicleState


class AxisFilter:
    """Kalman filter of a position and its constant velocity along one axis.

    In plain floats, as numpy only adds overhead for two numbers.

    Attributes:
        position_m: estimate.
        velocity_mps: estimate.
        p00: variance of the position [m²]; p01 covariance [m²/s]; p11 of the velocity [m²/s²].
    """

    __slots__ = ("p00", "p01", "p11", "position_m", "velocity_mps")

    def __init__(
        self, position_m: float, velocity_mps: float, position_sd_m: float, velocity_sd_mps: float
    ) -> None:
        self.position_m = position_m
        self.velocity_mps = velocity_mps
        self.p00 = position_sd_m * position_sd_m
        self.p01 = 0.0
        self.p11 = velocity_sd_mps * velocity_sd_mps

    def predict(self, dt_s: float, acceleration_sd_mps2: float) -> None:
        """Predict one step ahead, with a random acceleration that is constant within the step."""
        self.position_m += self.velocity_mps * dt_s
        noise = acceleration_sd_mps2 * acceleration_sd_mps2 * dt_s * dt_s
        self.p00 += dt_s * (2.0 * self.p01 + dt_s * self.p11) + 0.25 * noise * dt_s * dt_s
        self.p01 += dt_s * self.p11 + 0.5 * noise * dt_s
        self.p11 += noise

    def squared_innovation(self, measured_m: float, variance_m2: float) -> float:
        """Squared innovation divided by its variance."""
        innovation = measured_m - self.position_m
        return innovation * innovation / (self.p00 + variance_m2)

    def correct(self, measured_m: float, variance_m2: float) -> None:
        """Correct the estimates by a measurement."""
        total = self.p00 + variance_m2
        gain, velocity_gain = self.p00 / total, self.p01 / total
        innovation = measured_m - self.position_m
        self.position_m += gain * innovation
        self.velocity_mps += velocity_gain * innovation
        self.p11 -= velocity_gain * self.p01
        self.p00 *= 1.0 - gain
        self.p01 *= 1.0 - gain


Positive = Annotated[float, Meta(gt=0.0, le=100.0)]
Count = Annotated[int, Meta(ge=1, le=100)]


class TrackerSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How perceived positions become tracks.

    Attributes:
        range_slope: the sensor's specification sigma_x = range_slope · |dx| + range_base_m.
        range_base_m: constant term of sigma_x.
        lateral_slope: the sensor's specification sigma_y = lateral_slope · |dy| + lateral_base_m.
        lateral_base_m: constant term of sigma_y.
        range_acceleration_mps2: standard deviation of a vehicle's acceleration along the road.
        lateral_acceleration_mps2: standard deviation of its acceleration across the road.
        gate: largest accepted sum of both squared innovations over their variances; chi-square
            with two degrees of freedom, 9.21 for 99 %.
        misses_to_delete: rejected measurements in a row that end a confirmed track.
        hits_to_confirm: accepted measurements that confirm a tentative track.
        tentative_misses: rejected measurements that end a tentative track.
        first_speed_sd_mps: standard deviation of the speed of a new track, around the truck's own.
        again_speed_sd_mps: the same for a vehicle that reappears after its track was deleted.
        lateral_speed_sd_mps: standard deviation of the lateral speed of a new track, around 0.
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
    """State of a track in its life cycle."""

    TENTATIVE = "tentative"
    CONFIRMED = "confirmed"
    COASTING = "coasting"
    DELETED = "deleted"


class Track:
    """The planner's estimate of one vehicle.

    Attributes:
        along: filter along the road; across: filter across it.
        seen: the last perceived vehicle, for its size.
        evidence: evidence that it comes into the truck's lane; see `update_intent`.
        leads: whether it is considered the truck's lead.
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
    """One track for each perceived vehicle; the sensor lists the vehicles in a stable order.

    Attributes:
        lost: number of trusted tracks that were deleted since the start of the episode.
    """

    def __init__(self, settings: TrackerSettings, dt_s: float) -> None:
        self._settings = settings
        self._dt_s = dt_s
        self._tracks: dict[int, Track] = {}
        self._known: set[int] = set()
        self.lost = 0

    def update(self, perception: Perception) -> list[Track]:
        """Update the tracks by one perception, and return them, tentative ones included."""
        ego = perception.ego
        for slot, seen in enumerate(perception.others):
            track = self._tracks.get(slot)
            if track is not None:
                self._follow(track, seen, ego)
                self._update_state(slot, track)
            elif isfinite(seen.x_m) and isfinite(seen.y_m):
                self._tracks[slot] = self._start_track(seen, ego, slot in self._known)
        return list(self._tracks.values())

    def _start_track(self, seen: VehicleState, ego: VehicleState, again: bool) -> Track:
        settings = self._settings
        sd_mps = settings.again_speed_sd_mps if again else settings.first_speed_sd_mps
        along_sd, across_sd = self._sensor_deviations(seen.x_m - ego.x_m, seen.y_m - ego.y_m)
        along = AxisFilter(seen.x_m, ego.speed_mps, along_sd, sd_mps)
        across = AxisFilter(seen.y_m, 0.0, across_sd, settings.lateral_speed_sd_mps)
        return Track(along, across, seen)

    def _sensor_deviations(self, dx_m: float, dy_m: float) -> tuple[float, float]:
        """Specified standard deviations of the sensor at a distance. [m]"""
        settings = self._settings
        return (
            settings.range_slope * abs(dx_m) + settings.range_base_m,
            settings.lateral_slope * abs(dy_m) + settings.lateral_base_m,
        )

    def _follow(self, track: Track, seen: VehicleState, ego: VehicleState) -> None:
        """Predict the track, and correct it if the measurement passes the gate."""
        settings, along, across = self._settings, track.along, track.across
        along.predict(self._dt_s, settings.range_acceleration_mps2)
        across.predict(self._dt_s, settings.lateral_acceleration_mps2)
        sd_x, sd_y = self._sensor_deviations(
            along.position_m - ego.x_m, across.position_m - ego.y_m
        )
        var_x, var_y = sd_x * sd_x, sd_y * sd_y
        track.age += 1
        innovation = along.squared_innovation(seen.x_m, var_x) + across.squared_innovation(
            seen.y_m, var_y
        )
        # Written with "not", so that NaN is a miss.
        if not innovation <= settings.gate:
            track.misses += 1
            return
        along.correct(seen.x_m, var_x)
        across.correct(seen.y_m, var_y)
        track.seen = seen
        track.hits += 1
        track.misses = 0

    def _update_state(self, slot: int, track: Track) -> None:
        """Update the state of the track, and delete it at the end of its life cycle."""
        track.state = TRANSITIONS[track.state](track, self._settings)
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


TRANSITIONS = {
    TrackState.TENTATIVE: _after_tentative,
    TrackState.CONFIRMED: _after_confirmed,
    TrackState.COASTING: _after_confirmed,
}


class BrakeLightSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """When brake lights are on, and how they affect a track.

    Attributes:
        lit_from_mps2: deceleration from which a vehicle's brake lights are on.
        acceleration_mps2: standard deviation of its acceleration while they are on.
    """

    lit_from_mps2: Annotated[float, Meta(gt=0.0, le=10.0)] = 1.0
    acceleration_mps2: Annotated[float, Meta(ge=0.0, le=10.0)] = 5.0


class BrakeLightTracker(Tracker):
    """A tracker that takes brake lights into account.

    Attributes:
        braking: the tracks of vehicles with brake lights on.
    """

    def __init__(self, settings: TrackerSettings, lights: BrakeLightSettings, dt_s: float) -> None:
        super().__init__(settings, dt_s)
        self._lights = lights
        self._speeds_mps: dict[int, float] = {}
        self.braking: set[Track] = set()

    def update(self, perception: Perception) -> list[Track]:
        """Look for brake lights, then update the tracks; see `Tracker.update`."""
        self.braking = {
            self._tracks[slot]
            for slot, seen in enumerate(perception.others)
            if self._brakes(slot, seen.speed_mps) and slot in self._tracks
        }
        for track in self.braking:
            track.along.p11 += (self._lights.acceleration_mps2 * self._dt_s) ** 2
        return super().update(perception)

    def _brakes(self, slot: int, speed_mps: float) -> bool:
        before_mps = self._speeds_mps.get(slot, speed_mps)
        self._speeds_mps[slot] = speed_mps
        return before_mps - speed_mps >= self._lights.lit_from_mps2 * self._dt_s


Metres = Annotated[float, Meta(gt=0.0, le=10.0)]


class IntentSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How the intent to enter the truck's lane is recognised.

    Attributes:
        preview_s: how far ahead the lateral position is predicted.
        enter_m: a vehicle nearer than this to the truck's line gains evidence.
        leave_m: a vehicle farther than this loses evidence.
        commit: evidence at which a vehicle becomes the lead; it remains so until none is left.
        youngest_s: least age of a track of which the intent is recognised.
    """

    preview_s: Annotated[float, Meta(ge=0.0, le=5.0)] = 1.0
    enter_m: Metres = 2.4
    leave_m: Metres = 2.8
    commit: Annotated[int, Meta(ge=1, le=100)] = 5
    youngest_s: Annotated[float, Meta(ge=0.0, le=10.0)] = 1.5


def update_intent(track: Track, ego: VehicleState, dt_s: float, settings: IntentSettings) -> None:
    """Update the evidence of a track by one step, and whether it is the lead.

    The difference between the two thresholds keeps noise from switching the lead on and off.
    """
    if track.age * dt_s < settings.youngest_s:
        return
    across = track.across
    aside_m = abs(across.position_m - ego.y_m + settings.preview_s * across.velocity_mps)
    if aside_m < settings.enter_m:
        track.evidence = min(track.evidence + 1, settings.commit)
    elif aside_m > settings.leave_m:
        track.evidence = max(track.evidence - 1, 0)
    if track.evidence >= settings.commit:
        track.leads = True
    elif track.evidence == 0:
        track.leads = False
