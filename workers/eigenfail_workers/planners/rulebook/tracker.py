"""Tracks of perceived vehicles: constant-velocity Kalman filters with a gate.

The gate and the life cycle of a track are this planner's one known weakness. Measurements outside
the gate are rejected; a track with enough rejections in a row is deleted; and a vehicle that
reappears after that is assumed to drive as fast as the truck. White noise seldom causes this.

Brake lights widen the uncertainty of a track: a vehicle that brakes may come to a stop, and its
filter, which assumes nearly constant speed, would soon reject its positions. Lights are on or off:
they contain no deceleration.
"""

from enum import StrEnum
from math import isfinite
from typing import Final

from eigenfail.values.scene import Perception, VehicleState
from eigenfail_workers.planners.rulebook.settings import (
    BrakeLightSettings,
    IntentSettings,
    TrackerSettings,
)


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


class TrackState(StrEnum):
    """State of a track in its life cycle."""

    TENTATIVE = "tentative"
    CONFIRMED = "confirmed"
    COASTING = "coasting"
    DELETED = "deleted"


TRUSTED: Final = (TrackState.CONFIRMED, TrackState.COASTING)
"""States of tracks that the planner may act on."""


class Track:
    """The planner's estimate of one vehicle.

    Attributes:
        along: filter along the road; across: filter across it.
        seen: the last perceived vehicle, for its size.
        evidence: evidence that it comes into the truck's lane; see `update_intent`.
        leads: whether it is considered the truck's lead.
        number: number of the vehicle, as the sensor has it.
    """

    __slots__ = (
        "across",
        "age",
        "along",
        "evidence",
        "hits",
        "leads",
        "misses",
        "number",
        "seen",
        "state",
    )

    def __init__(
        self, along: AxisFilter, across: AxisFilter, seen: VehicleState, number: int = 0
    ) -> None:
        self.number = number
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
        """True if the planner may act on the track."""
        return self.state in TRUSTED


class Tracker:
    """One track for each perceived vehicle; the sensor numbers the vehicles.

    Attributes:
        lost: number of trusted tracks that were deleted since the start of the episode.
        losses: number of deleted trusted tracks of each vehicle, by its number, if there were any.
        lost_now: numbers of the vehicles whose trusted tracks the last update deleted.
    """

    def __init__(self, settings: TrackerSettings, dt_s: float) -> None:
        self._settings = settings
        self._dt_s = dt_s
        self._tracks: dict[int, Track] = {}
        self._known: set[int] = set()
        self.lost = 0
        self.losses: dict[int, int] = {}
        self.lost_now: list[int] = []

    def update(self, perception: Perception) -> list[Track]:
        """Update the tracks by one perception, and return them, tentative ones included."""
        ego = perception.ego
        self.lost_now = []
        # A vehicle that the sensor does not report counts as missed, as one outside of the gate
        # does. The list is made first: the loop deletes tracks.
        for slot in [slot for slot in self._tracks if slot not in perception.ids]:
            unseen = self._tracks[slot]
            self._predict(unseen)
            unseen.misses += 1
            self._update_state(slot, unseen)
        for slot, seen in zip(perception.ids, perception.others, strict=True):
            track = self._tracks.get(slot)
            if track is not None:
                self._follow(track, seen, ego)
                self._update_state(slot, track)
            elif isfinite(seen.x_m) and isfinite(seen.y_m):
                self._tracks[slot] = self._start_track(slot, seen, ego)
        return list(self._tracks.values())

    def _start_track(self, slot: int, seen: VehicleState, ego: VehicleState) -> Track:
        settings, again = self._settings, slot in self._known
        # The known weakness: a vehicle that was lost is taken to drive as fast as the truck, with
        # little doubt, so that its true positions may miss the gate again.
        sd_mps = settings.again_speed_sd_mps if again else settings.first_speed_sd_mps
        along_sd, across_sd = self._sensor_deviations(seen.x_m - ego.x_m, seen.y_m - ego.y_m)
        along = AxisFilter(seen.x_m, ego.speed_mps, along_sd, sd_mps)
        across = AxisFilter(seen.y_m, 0.0, across_sd, settings.lateral_speed_sd_mps)
        return Track(along, across, seen, slot)

    def _sensor_deviations(self, dx_m: float, dy_m: float) -> tuple[float, float]:
        """Specified standard deviations of the sensor at a distance. [m]"""
        settings = self._settings
        return (
            settings.range_slope * abs(dx_m) + settings.range_base_m,
            settings.lateral_slope * abs(dy_m) + settings.lateral_base_m,
        )

    def _follow(self, track: Track, seen: VehicleState, ego: VehicleState) -> None:
        """Predict the track, and correct it if the measurement passes the gate."""
        self._predict(track)
        settings, along, across = self._settings, track.along, track.across
        sd_x, sd_y = self._sensor_deviations(
            along.position_m - ego.x_m, across.position_m - ego.y_m
        )
        var_x, var_y = sd_x * sd_x, sd_y * sd_y
        # One gate over both axes: chi-square with two degrees of freedom.
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

    def _predict(self, track: Track) -> None:
        settings = self._settings
        track.along.predict(self._dt_s, settings.range_acceleration_mps2)
        track.across.predict(self._dt_s, settings.lateral_acceleration_mps2)
        track.age += 1

    def _update_state(self, slot: int, track: Track) -> None:
        """Update the state of the track, and delete it at the end of its life cycle."""
        track.state = TRANSITIONS[track.state](track, self._settings)
        if track.is_trusted:
            self._known.add(slot)
        if track.state is TrackState.DELETED:
            del self._tracks[slot]
            # A tentative track that dies was never acted on: it is no loss.
            if track.hits >= self._settings.hits_to_confirm:
                self.lost += 1
                self.lost_now.append(slot)
                self.losses[slot] = self.losses.get(slot, 0) + 1


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
        # A speed of long ago would make a vehicle that is detected again seem to brake.
        for slot in [slot for slot in self._speeds_mps if slot not in perception.ids]:
            del self._speeds_mps[slot]
        self.braking = {
            self._tracks[slot]
            for slot, seen in zip(perception.ids, perception.others, strict=True)
            if self._brakes(slot, seen.speed_mps) and slot in self._tracks
        }
        for track in self.braking:
            # Before the update, so that this step's gate is already as wide as the braking demands.
            track.along.p11 += (self._lights.acceleration_mps2 * self._dt_s) ** 2
        return super().update(perception)

    def _brakes(self, slot: int, speed_mps: float) -> bool:
        before_mps = self._speeds_mps.get(slot, speed_mps)
        self._speeds_mps[slot] = speed_mps
        return before_mps - speed_mps >= self._lights.lit_from_mps2 * self._dt_s


def update_intent(track: Track, ego: VehicleState, dt_s: float, settings: IntentSettings) -> None:
    """Update the evidence of a track by one step, and whether it is the lead.

    The difference between the two thresholds keeps noise from switching the lead on and off.
    """
    # The lateral speed of a young track is mostly noise, and is multiplied by the preview.
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
