"""Recorded traffic as a scenario: a planner replaces one vehicle, the others replay the recording.

Once the ego is further than a set distance from its recorded place, the recording no longer shows
how other vehicles would react. From then on they follow the vehicle ahead of them, by the
Intelligent Driver Model, along their recorded paths. Vehicles come and go as in the recording.
"""

from math import cos, hypot, sin, sqrt, tanh
from typing import Annotated, ClassVar

import msgspec
import numpy as np
from msgspec import Meta

from eigenfail.errors import InvalidValue, clean_text
from eigenfail.values.arrays import Floats
from eigenfail.values.disturbance import Doubles
from eigenfail.values.scene import Mission, VehicleState
from eigenfail_exchange.recorded_traffic.columns import STANDING_MPS
from eigenfail_exchange.recorded_traffic.tracks import RecordedTracks

# Treiber, Hennecke, Helbing: Congested traffic states in empirical observations and microscopic
# simulations, Physical Review E 62 (2000), table I.
TIME_GAP_S = 1.6
ACCELERATION_MPS2 = 0.73
DECELERATION_MPS2 = 1.67
STANDSTILL_GAP_M = 2.0
EXPONENT = 4


HARDEST_BRAKING_MPS2 = 9.0
"""No reactive vehicle brakes harder, whatever the model asks for."""


class RecordedTrafficParameters(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of recorded traffic."""

    reactive_from_m: Annotated[
        float,
        Meta(
            ge=0.1,
            le=10_000.0,
            description="Distance of the ego from its recorded place from which others react [m].",
        ),
    ] = 5.0


class RecordedTraffic:
    """Base of a scenario that replays tracks; a subclass sets them, and its road.

    Vehicles that come or go in the recording do so in an episode.

    Attributes:
        tracks: the recording; its first vehicle is replaced by the ego.
        lanes: number of lanes, lane 0 with its centre at y = 0, the others to its left.
        lane_width_m: width of a lane.
        speed_limit_mps: speed limit in the planner's mission.
    """

    Parameters: ClassVar[type[msgspec.Struct]] = RecordedTrafficParameters
    tracks: ClassVar[RecordedTracks]
    lanes: ClassVar[int] = 2
    lane_width_m: ClassVar[float] = 3.5
    speed_limit_mps: ClassVar[float] = 25.0

    @property
    def left_out(self) -> tuple[str, ...]:
        """Vehicles of the recording that episodes lack, a sentence for each."""
        return tuple(f"'{name}': {why}" for name, why in self.tracks.left_out.items())

    @property
    def notes(self) -> tuple[str, ...]:
        """Other parts of the recording that were not used or were changed, in sentences."""
        return self.tracks.notes

    def __call__(
        self,
        parameters: RecordedTrafficParameters,
        seed: int,  # noqa: ARG002 - the contract's; nothing in a recording is random
    ) -> "RecordedSituation | ChangingSituation":
        """Return the situation at the start of the recording.

        Raises:
            InvalidValue: the recorded ego never moves, or does not end ahead of its start.
        """
        course, ego = self.tracks.states[:, 0], self.tracks.ids[0]
        if not course[:, 3].max() >= STANDING_MPS:
            problem = (
                f"Vehicle '{ego}' stands all the time: a planner would have no speed to reach."
            )
            raise InvalidValue("tracks", problem, "Choose another ego.")
        if not course[-1, 0] > course[0, 0]:
            problem = f"Vehicle '{ego}' does not end ahead of its start along x."
            raise InvalidValue("tracks", problem, "Give `read_tracks` the frame of its road.")
        mission = Mission(
            dt_s=self.tracks.dt_s,
            lanes=self.lanes,
            lane_width_m=self.lane_width_m,
            speed_limit_mps=self.speed_limit_mps,
            desired_speed_mps=min(float(course[:, 3].max()), self.speed_limit_mps),
            goal_x_m=float(course[-1, 0]),
        )
        stays = bool(np.isfinite(self.tracks.states).all())
        kind = RecordedSituation if stays else ChangingSituation
        return kind(self.tracks, mission, parameters.reactive_from_m)


class RecordedSituation:
    """The start of a recording whose vehicles are there all the time (`Situation`).

    Vehicles that react depend on the course of the ego, so that a situation serves one episode at a
    time: the first step of its first actor begins another.

    Args:
        tracks: the recording; its first vehicle is the ego.
        mission: road and task.
        reactive_from_m: distance of the ego from its recorded place beyond which others react.
    """

    def __init__(self, tracks: RecordedTracks, mission: Mission, reactive_from_m: float) -> None:
        self.mission = mission
        self.steps = len(tracks.states) - 1
        self._tracks = tracks
        self._limit_m = reactive_from_m
        self.ego = _make_state(tracks, 0, 0)
        self.actors = tuple(_make_state(tracks, n, 0) for n in range(1, len(tracks.ids)))
        self._restart()

    def move_actor(self, actor: int, step: int, ego: VehicleState) -> VehicleState:
        """Return the state of a vehicle after `step` steps, recorded or reactive."""
        # The contract has no start of an episode: its first question is the only sign of it.
        if actor == 0 and step <= 1:
            self._restart()
        # All vehicles move at once, since they react to each other; the other actors of the step
        # are then looked up.
        while len(self._states) <= step:
            there = self._traffic.advance(len(self._states), ego)
            self._states.append(tuple(there.values()))
        return self._states[step][actor]

    def _restart(self) -> None:
        self._states: list[tuple[VehicleState, ...]] = [self.actors]
        self._traffic = RecordedVehicles(self._tracks, self.mission.dt_s, self._limit_m)


class ChangingSituation:
    """The start of a recording with vehicles that come or go (`ReactiveSituation`).

    Args:
        tracks: the recording; its first vehicle is the ego.
        mission: road and task.
        reactive_from_m: distance of the ego from its recorded place beyond which others react.
    """

    def __init__(self, tracks: RecordedTracks, mission: Mission, reactive_from_m: float) -> None:
        self.mission = mission
        self.steps = len(tracks.states) - 1
        self._tracks = tracks
        self._limit_m = reactive_from_m
        self.ego = _make_state(tracks, 0, 0)
        self.actors = tuple(
            _make_state(tracks, number, 0)
            for number in range(1, len(tracks.ids))
            if np.isfinite(tracks.states[0, number, 0])
        )
        self.challenges = tuple(f"vehicle {clean_text(name)}" for name in tracks.ids[1:])

    def start_traffic(self) -> "RecordedVehicles":
        """Return the vehicles of a new episode."""
        return RecordedVehicles(self._tracks, self.mission.dt_s, self._limit_m)


class RecordedVehicles:
    """The vehicles of a recording in the course of one episode (`TrafficModel`).

    Once they react, a vehicle that comes later does so at its recorded times and places, as soon as
    there is room for it. One that went in the recording goes at the end of its recorded path.

    Args:
        tracks: the recording; its first vehicle is the ego.
        dt_s: duration of a step.
        limit_m: distance between the ego and its recorded place beyond which other vehicles react.
    """

    def __init__(self, tracks: RecordedTracks, dt_s: float, limit_m: float) -> None:
        self._tracks = tracks
        self._dt_s = dt_s
        self._limit_m = limit_m
        self._paths = [_Path(tracks, number) for number in range(1, len(tracks.ids))]
        self._there = self._find_recorded(0)
        self._progress: dict[int, tuple[float, float]] = {}
        self._reacts = False
        self._came = set(self._there)

    def advance(self, step: int, ego: VehicleState) -> dict[int, VehicleState]:
        """Return the vehicles after a step by number; `ego` is the ego after the step."""
        if not self._reacts:
            recorded = self._find_recorded(step)
            if self._is_valid(recorded, step, ego):
                self._there = recorded
                self._came |= set(recorded)
                return recorded
            # Never back: the recording is of traffic that has not met this ego.
            self._reacts = True
            for path in self._paths:
                if path.number in self._there:
                    way_m = path.find_way(step - 1)
                    self._progress[path.number] = way_m, self._there[path.number].speed_mps
        self._there = self._react(step, ego)
        return self._there

    def _find_recorded(self, step: int) -> dict[int, VehicleState]:
        return {
            path.number: _make_state(self._tracks, path.number, step)
            for path in self._paths
            if path.is_recorded(step)
        }

    def _is_valid(self, recorded: dict[int, VehicleState], step: int, ego: VehicleState) -> bool:
        """Return whether the ego is near its recorded place, and no new vehicle overlaps it."""
        x_m, y_m = self._tracks.states[step, 0, :2]
        if not hypot(ego.x_m - x_m, ego.y_m - y_m) <= self._limit_m:
            return False
        new = recorded.keys() - self._came
        return not new or all(_has_room(recorded[number], (ego,), 0.0) for number in new)

    def _react(self, step: int, ego: VehicleState) -> dict[int, VehicleState]:
        before = self._there
        there: dict[int, VehicleState] = {}
        for path in self._paths:
            if path.number in before:
                state = self._drive(path, before, ego)
                if not path.has_ended(self._progress[path.number][0]):
                    there[path.number] = state
            elif path.number not in self._came and path.is_recorded(step):
                state = _make_state(self._tracks, path.number, step)
                others = (ego, *before.values(), *there.values())
                if _has_room(state, others, STANDSTILL_GAP_M):
                    there[path.number] = state
                    self._progress[path.number] = path.find_way(step), state.speed_mps
                    self._came.add(path.number)
        if not there:
            # An episode always has a vehicle: the last one drives straight on.
            number = next(iter(before))
            there[number] = self._paths[number - 1].place(*self._progress[number])
        return there

    def _drive(
        self, path: "_Path", before: dict[int, VehicleState], ego: VehicleState
    ) -> VehicleState:
        """Move a vehicle by a step."""
        state = before[path.number]
        if path.is_parked:
            return state
        way_m, speed = self._progress[path.number]
        others = (ego, *(each for each in before.values() if each is not state))
        wanted = _find_acceleration(state, others, path.desired_mps)
        after = max(speed + wanted * self._dt_s, 0.0)
        place = way_m + 0.5 * (speed + after) * self._dt_s, after
        self._progress[path.number] = place
        return path.place(*place)


class _Path:
    """The recorded path of a vehicle by the way along it.

    Attributes:
        number: number of the vehicle in the tracks.
        way_m: way along the path at each recorded step of the vehicle. [m]
        desired_mps: its largest recorded speed.
        is_parked: whether it stood all the time; then it never moves.
    """

    def __init__(self, tracks: RecordedTracks, number: int) -> None:
        self.number = number
        there = np.flatnonzero(np.isfinite(tracks.states[:, number, 0]))
        self._first, self._last = int(there[0]), int(there[-1])
        self._goes = self._last < len(tracks.states) - 1
        self._course: Doubles = tracks.states[self._first : self._last + 1, number]
        self._length_m, self._width_m = map(float, tracks.sizes[number])
        moved = np.diff(self._course[:, :2], axis=0)
        self.way_m = np.concatenate([[0.0], np.cumsum(np.hypot(moved[:, 0], moved[:, 1]))])
        self.desired_mps = float(self._course[:, 3].max())
        self.is_parked = self.desired_mps < STANDING_MPS

    def is_recorded(self, step: int) -> bool:
        """Return whether the vehicle is there at a step of the recording."""
        return self._first <= step <= self._last

    def find_way(self, step: int) -> float:
        """Return the recorded way at a step. [m]"""
        return float(self.way_m[step - self._first])

    def has_ended(self, way_m: float) -> bool:
        """Return whether a vehicle that went in the recording is beyond the end of its path."""
        return self._goes and not self.is_parked and way_m > float(self.way_m[-1])

    def place(self, way_m: float, speed_mps: float) -> VehicleState:
        """Return the vehicle at a way along its path, and straight on behind the end of it."""
        beyond_m = max(way_m - float(self.way_m[-1]), 0.0)
        x_m, y_m, heading = (
            float(np.interp(way_m, self.way_m, self._course[:, column])) for column in range(3)
        )
        return VehicleState(
            x_m + beyond_m * cos(heading),
            y_m + beyond_m * sin(heading),
            heading,
            speed_mps,
            self._length_m,
            self._width_m,
        )


def _has_room(vehicle: VehicleState, others: tuple[VehicleState, ...], least_m: float) -> bool:
    """Return whether a new vehicle is apart from all others, with enough room to brake.

    Args:
        vehicle: the vehicle.
        others: all others.
        least_m: least gap along the vehicle.
    """
    for other in others:
        dx, dy = other.x_m - vehicle.x_m, other.y_m - vehicle.y_m
        c, s = cos(vehicle.heading_rad), sin(vehicle.heading_rad)
        turn = other.heading_rad - vehicle.heading_rad
        along, across = abs(cos(turn)), abs(sin(turn))
        reach_m = 0.5 * (vehicle.length_m + other.length_m * along + other.width_m * across)
        side_m = 0.5 * (vehicle.width_m + other.length_m * across + other.width_m * along)
        if abs(c * dx + s * dy) < reach_m + least_m and abs(c * dy - s * dx) < side_m:
            return False
        for rear, front in ((vehicle, other), (other, vehicle)) if least_m else ():
            gap_m, closing_mps = _find_gap(rear, front), rear.speed_mps - front.speed_mps
            needed_m = max(closing_mps, 0.0) ** 2 / (2.0 * HARDEST_BRAKING_MPS2)
            if gap_m is not None and gap_m < least_m + needed_m:
                return False
    return True


def _make_state(tracks: RecordedTracks, number: int, step: int) -> VehicleState:
    return VehicleState(*map(float, (*tracks.states[step, number], *tracks.sizes[number])))


def _find_acceleration(
    vehicle: VehicleState, others: tuple[VehicleState, ...], desired_mps: float
) -> float:
    """Return the acceleration of the Intelligent Driver Model, eq. 2 and 3. [m/s²]

    People follow each other at gaps that the model takes for an emergency. So a vehicle brakes by
    at most the comfortable deceleration more than its closing speed needs. This is the ACC model of
    Kesting, Treiber, Helbing, Enhanced intelligent driver model to access the impact of driving
    strategies on traffic capacity, Phil. Trans. R. Soc. A 368 (2010), with a coolness of 1 and a
    vehicle ahead that keeps its speed. The gap may shrink to the standstill gap.

    Args:
        vehicle: the vehicle that follows.
        others: all other vehicles; the nearest one ahead that is in its way is followed.
        desired_mps: its speed on a free road.
    """
    free = 1.0 - (vehicle.speed_mps / desired_mps) ** EXPONENT
    wanted = ACCELERATION_MPS2 * free
    for other in others:
        gap_m = _find_gap(vehicle, other)
        if gap_m is None:
            continue
        closing_mps = vehicle.speed_mps - other.speed_mps
        comfort = 2.0 * sqrt(ACCELERATION_MPS2 * DECELERATION_MPS2)
        dynamic_m = vehicle.speed_mps * (TIME_GAP_S + closing_mps / comfort)
        share = (STANDSTILL_GAP_M + max(dynamic_m, 0.0)) / max(gap_m, 0.01)
        follow = ACCELERATION_MPS2 * (free - share**2)
        needed = -(max(closing_mps, 0.0) ** 2) / (2.0 * max(gap_m - STANDSTILL_GAP_M, 0.01))
        if follow < needed:
            follow = needed + DECELERATION_MPS2 * tanh((follow - needed) / DECELERATION_MPS2)
        wanted = min(wanted, follow)
    return max(wanted, -HARDEST_BRAKING_MPS2)


def _find_gap(vehicle: VehicleState, other: VehicleState) -> float | None:
    """Return the gap to a vehicle that is ahead and in the way; None to any other one. [m]"""
    dx, dy = other.x_m - vehicle.x_m, other.y_m - vehicle.y_m
    c, s = cos(vehicle.heading_rad), sin(vehicle.heading_rad)
    along, across = c * dx + s * dy, c * dy - s * dx
    if along <= 0.0 or abs(across) >= 0.5 * (vehicle.width_m + other.width_m):
        return None
    return along - 0.5 * (vehicle.length_m + other.length_m)


def find_log_validity(tracks: RecordedTracks, course: Floats | Doubles, distance_m: float) -> float:
    """Return how long a recording stays valid in an episode: until the ego leaves it. [s]

    Args:
        tracks: the recording that the episode replays.
        course: x and y of the ego from the start of the recording on, in the first two columns,
            shape (steps + 1, at least 2): of an episode `scene.vehicles[:, 0]`. [m]
        distance_m: distance from its recorded place above which the ego has left the recording.

    Returns:
        The time of the first step at which the ego is further away; the end of the course if it
        never is.
    """
    steps = min(len(course), len(tracks.states))
    offsets = course[:steps, :2].astype(np.float64) - tracks.states[:steps, 0, :2]
    # A place that is not a number is not a valid one either.
    left = np.flatnonzero(~(np.hypot(offsets[:, 0], offsets[:, 1]) <= distance_m))
    return float(left[0] if len(left) else steps - 1) * tracks.dt_s
