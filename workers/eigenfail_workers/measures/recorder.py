"""The record of one episode: disturbances, observations and measures."""

from collections.abc import Sequence
from math import inf, nan
from typing import Any, Final, NamedTuple

import numpy as np

from eigenfail.errors import SimulatorError
from eigenfail.values import requirements
from eigenfail.values.arrays import LARGEST_FLOAT32, RANGE, Floats, fits_float32
from eigenfail.values.disturbance import DisturbanceModel, NoiseTrajectory
from eigenfail.values.episode import Importance
from eigenfail.values.measures import Measures
from eigenfail.values.records import NEAR_MISS_TTC_S
from eigenfail.values.scene import PEAK_BRAKING_MPS2, Control, Observation, Scene
from eigenfail.values.shapes import Row
from eigenfail.values.signals import DrivenCourse
from eigenfail_workers.measures import encounters
from eigenfail_workers.measures.geometry import find_struck, separation, velocity
from eigenfail_workers.measures.importance import Approach, compute_importance
from eigenfail_workers.measures.signals import SignalRecorder
from eigenfail_workers.values import Encounter, Separation, TrafficConflict

HARD_BRAKING_MPS2: Final = 3.0
"""Braking beyond this is hard: about the 10 ft/s² that ITE's formula for yellow lights takes for a
comfortable deceleration, and above the 2.5 m/s² from which `rulebook` calls braking uncomfortable.
"""


class RideMonitor:
    """Measures how roughly the truck is driven: jerk, hard braking, clipped controls.

    Jerk is |a_t - a_{t-1}| / dt of the applied acceleration. Before the first step it is 0:
    situations begin in steady driving. A truck at rest does not brake, whatever its control is.
    """

    def __init__(self) -> None:
        self._applied_mps2 = 0.0
        self._largest_change_mps2 = 0.0
        self._speed_mps = 0.0
        self._braking_hard = False
        self._is_known = False
        self._hard_brakings = 0
        self._clipped_steps = 0

    def observe(self, observation: Observation) -> None:
        """Take in the start, or the state after a step."""
        applied = observation.applied
        if applied is not None:
            self._is_known = True
            self._follow(applied.acceleration_mps2)
            self._clipped_steps += applied != observation.control
        self._speed_mps = observation.ego.speed_mps

    def _follow(self, requested_mps2: float) -> None:
        applied_mps2 = requested_mps2 if self._speed_mps > 0.0 else max(requested_mps2, 0.0)
        change = abs(applied_mps2 - self._applied_mps2)
        self._largest_change_mps2 = max(self._largest_change_mps2, change)
        self._applied_mps2 = applied_mps2
        # Counted when it begins: braking hard for three seconds is one event, not thirty.
        hard = applied_mps2 < -HARD_BRAKING_MPS2
        self._hard_brakings += hard and not self._braking_hard
        self._braking_hard = hard

    def max_jerk_mps3(self, dt_s: float) -> float | None:
        """Return the largest jerk; None if the simulator does not report the applied control."""
        return self._largest_change_mps2 / dt_s if self._is_known else None

    @property
    def hard_brakings(self) -> int | None:
        """Number of times that hard braking began; None if the applied control is not reported."""
        return self._hard_brakings if self._is_known else None

    @property
    def clipped_steps(self) -> int | None:
        """Number of steps with another control than the requested one; None if not reported."""
        return self._clipped_steps if self._is_known else None


class FirstViolations(NamedTuple):
    """Steps at which thresholds were first passed, by one vehicle or by any; None if never.

    Attributes:
        ttc_step: TTC < 1.5 s.
        drac_step: DRAC > 7.0 m/s².
        drac_at_warning_mps2: DRAC at `ttc_step`.
    """

    ttc_step: int | None = None
    drac_step: int | None = None
    drac_at_warning_mps2: float | None = None


NO_VIOLATIONS = FirstViolations()


class ViolationTracker:
    """Smallest TTC and largest DRAC of an episode, and the first violations by each vehicle."""

    def __init__(self) -> None:
        self._min_ttc_s = inf
        self._max_drac_mps2 = 0.0
        self._first: dict[int, FirstViolations] = {}

    def add(self, step: int, vehicle: int, conflict: TrafficConflict) -> None:
        """Add a conflict with a vehicle after a step; call it in the order of the steps."""
        self._min_ttc_s = min(self._min_ttc_s, conflict.ttc_s)
        self._max_drac_mps2 = max(self._max_drac_mps2, conflict.drac_mps2)
        first = self._first.get(vehicle, NO_VIOLATIONS)
        if first.ttc_step is None and conflict.ttc_s < NEAR_MISS_TTC_S:
            first = first._replace(ttc_step=step, drac_at_warning_mps2=conflict.drac_mps2)
        if first.drac_step is None and conflict.drac_mps2 > PEAK_BRAKING_MPS2:
            first = first._replace(drac_step=step)
        self._first[vehicle] = first

    @property
    def min_ttc_s(self) -> float | None:
        """Smallest time to collision with any vehicle; None without a conflict. [s]"""
        return self._min_ttc_s if self._min_ttc_s < inf else None

    @property
    def max_drac_mps2(self) -> float | None:
        """Largest DRAC towards any vehicle; None without a conflict. [m/s²]"""
        return self._max_drac_mps2 if self._max_drac_mps2 > 0.0 else None

    def get_first_violations(self, vehicle: int) -> FirstViolations:
        """Return the first violations by one vehicle."""
        return self._first.get(vehicle, NO_VIOLATIONS)

    def find_earliest_violations(self) -> FirstViolations:
        """Return the earliest violations by any vehicle, with the DRAC at the earliest warning."""
        warned = [first for first in self._first.values() if first.ttc_step is not None]
        warning = min(warned, key=_ttc_step, default=NO_VIOLATIONS)
        drac_steps = [each.drac_step for each in self._first.values() if each.drac_step is not None]
        return warning._replace(drac_step=min(drac_steps, default=None))


def _ttc_step(first: FirstViolations) -> float:
    return inf if first.ttc_step is None else first.ttc_step


class Apart(NamedTuple):
    """The ego and another vehicle at one moment, and how far they are apart."""

    pair: encounters.Pair
    between: Separation


Encounters = dict[int, Encounter]
"""Encounters with the other vehicles, by number."""

POSITION_NOISE = DisturbanceModel()


class Recorder:
    """Accumulates an episode: its measures step by step, its arrays at the end.

    Args:
        model: model of the noise that is added.
        importance: importance function to be recorded; None for none.
        judge: what judges the episode; None if only no collision is required.
    """

    def __init__(
        self,
        model: DisturbanceModel = POSITION_NOISE,
        importance: Importance | None = None,
        judge: requirements.EpisodeJudge | None = None,
    ) -> None:
        self._shape = model.noise_shape
        self._names = [channel.name for channel in model.list_channels()]
        self._judge = judge
        self._signals = SignalRecorder(judge.signals) if judge is not None else None
        self._importance = importance
        self._importances: list[float] = []
        self._z: list[Row] = []
        self._sigma: list[Row] = []
        self._course: list[Observation] = []
        self._robustness_m = inf
        self._violations = ViolationTracker()
        self._ride = RideMonitor()
        self._left_road_step: int | None = None
        self._last_drac_mps2 = 0.0
        self._apart: dict[int, Apart] = {}

    @property
    def steps(self) -> int:
        """Number of disturbances."""
        return len(self._z)

    @property
    def collided(self) -> bool:
        """True if the last observation was a collision."""
        return bool(self._course) and self._course[-1].collided

    def add_disturbance(self, z: Row, sigma: Row) -> None:
        """Add the disturbance of the next step; both hold values of float32."""
        self._z.append(z)
        self._sigma.append(sigma)

    def observe(self, seen: Observation, dt_s: float) -> Observation:
        """Take in the start, or the state after a step.

        Args:
            seen: what the simulator shows.
            dt_s: duration of a step.

        Returns:
            The observation that is recorded: with a collision if footprints met since the last one.

        Raises:
            InvalidValue: the episode starts in a collision.
            SimulatorError: a position, heading or speed is not a finite number; or footprints rule
                out a reported collision.
        """
        before, frame_s = self._course[-1] if self._course else None, dt_s / (1 + len(seen.frames))
        met: Encounters = {}
        for frame in (*seen.frames, seen):
            _check(frame)
            observation = before = encounters.end_at_contact(before, frame, frame_s)
            met = self._meet(observation, met, frame_s)
            if observation.collided:
                break
        self._course.append(observation)
        self._ride.observe(observation)
        if observation.off_road and self._left_road_step is None:
            self._left_road_step = observation.step
        compared = list(met.values())
        if self._signals is not None:
            self._signals.observe(observation, compared)
        if self._importance is not None and observation.step:
            control = observation.applied or observation.control
            acceleration_mps2 = control.acceleration_mps2 if control else 0.0
            approach = Approach(compared, acceleration_mps2)
            self._importances.append(compute_importance(self._importance, approach))
        return observation

    def _meet(self, now: Observation, met: Encounters, dt_s: float) -> Encounters:
        """Compare the ego with each vehicle at a moment, by number.

        Args:
            now: the moment.
            met: encounters at earlier moments of the same step.
            dt_s: time since the previous moment.
        """
        self._last_drac_mps2 = 0.0
        # Vehicles that are not there now are forgotten: when one comes back, nobody knows its way.
        before, self._apart = self._apart, {}
        found = {}
        for number, other in zip(now.numbers, now.others, strict=True):
            pair = encounters.Pair(now.ego, other)
            one = self._compare(now.step, number, pair, before.get(number), dt_s)
            if earlier := met.get(number):
                nearest_m = min(earlier.distance_m, one.distance_m)
                one = Encounter(nearest_m, one.conflict, earlier.conflicts + one.within)
            found[number] = one
        return found

    def _compare(
        self,
        step: int,
        number: int,
        pair: encounters.Pair,
        before: Apart | None,
        dt_s: float,
    ) -> Encounter:
        """Compare the ego with a vehicle after a step, and within it.

        Args:
            step: number of the step.
            number: number of the vehicle.
            pair: the two of them after the step.
            before: how they were apart before the step; None if the vehicle was not there.
            dt_s: duration of the step.
        """
        between = separation(pair.ego, pair.other)
        self._apart[number] = Apart(pair, between)
        distance_m = between.distance_m
        within: tuple[TrafficConflict, ...] = ()
        if before is not None:
            passed = encounters.find_pass(before.pair, pair, before.between, between)
            distance_m = distance_m if passed is None else passed.distance_m
            if dt_s > encounters.LONGEST_STEP_S:
                within = tuple(encounters.list_conflicts(before.pair, pair, dt_s))
        self._robustness_m = min(self._robustness_m, distance_m)
        conflict = encounters.find_conflict(pair.ego, pair.other, between)
        for each in within:
            self._violations.add(step, number, each)
        if conflict is not None:
            self._violations.add(step, number, conflict)
            self._last_drac_mps2 = max(self._last_drac_mps2, conflict.drac_mps2)
        return Encounter(distance_m, conflict, within)

    def noise(self) -> NoiseTrajectory:
        """Return the disturbances so far."""
        z, sigma = (_to_array(rows, len(self._names)) for rows in (self._z, self._sigma))
        return NoiseTrajectory(z, sigma, self._shape)

    def measures(self, dt_s: float) -> Measures:
        """Return the measures of the episode; on a collision, robustness is exactly 0."""
        last, found, ride = self._course[-1], self._violations, self._ride
        collided = self.collided
        first = found.find_earliest_violations()
        if collided:
            # After a crash only warnings of the struck vehicle count. The warning of another
            # vehicle would give a lead time to a crash that came without one.
            first = found.get_first_violations(last.numbers[find_struck(last.ego, last.others)])
        return Measures(
            robustness_m=0.0 if collided else self._robustness_m,
            severity=compute_severity(last) if collided else None,
            min_ttc_s=found.min_ttc_s,
            max_drac_mps2=found.max_drac_mps2,
            ttc_violated_s=_time_s(first.ttc_step, dt_s),
            drac_violated_s=_time_s(first.drac_step, dt_s),
            drac_at_warning_mps2=first.drac_at_warning_mps2,
            collided_s=_time_s(last.step if collided else None, dt_s),
            left_road_s=_time_s(self._left_road_step, dt_s),
            max_jerk_mps3=ride.max_jerk_mps3(dt_s),
            hard_brakings=ride.hard_brakings,
            clipped_steps=ride.clipped_steps,
            final_drac_mps2=None if collided else self._last_drac_mps2,
            cause=last.cause,
            peak_braking_mps2=self._course[0].peak_braking_mps2,
        )

    def judge(self, measures: Measures, dt_s: float) -> requirements.RequirementVerdict | None:
        """Return what the requirements say of the episode; None without any.

        Args:
            measures: of the episode.
            dt_s: duration of a step.

        Raises:
            EpisodeError: one of them cannot be judged.
        """
        if self._judge is None or self._signals is None:
            return None
        signals = self._signals.collect(self.noise(), self._names, dt_s)
        return self._judge.judge(DrivenCourse(dt_s, signals, measures))

    def importance(self) -> Floats | None:
        """Return the importance after each step, shape (steps,); None if it is not recorded.

        Raises:
            SimulatorError: a value is outside the range that is stored.
        """
        if self._importance is None:
            return None
        recorded = np.array(self._importances, np.float64)
        beyond = np.flatnonzero(~(np.abs(recorded) <= LARGEST_FLOAT32))
        if len(beyond):
            problem = f"The importance after step {beyond[0]} is {recorded[beyond[0]]}."
            raise SimulatorError(problem, f"It must be a number {RANGE}: look at the scene.")
        return recorded.astype(np.float32)

    def scene(self, dt_s: float) -> Scene:
        """Return the course of the episode."""
        rest = self._course[1:]
        vehicles, sizes = _place_vehicles(self._course)
        controls = [seen.control for seen in rest if seen.control is not None]
        return Scene(
            dt_s=dt_s,
            vehicles=vehicles,
            sizes=sizes,
            perceived=_to_array([seen.perceived for seen in rest if seen.perceived is not None], 2),
            controls=_to_array([(c.acceleration_mps2, c.steering_rad) for c in controls], 2),
        )


def _check(observation: Observation) -> None:
    for vehicle in (observation.ego, *observation.others):
        numbers: Any = vehicle  # of whatever type they are
        # A sum of magnitudes is not finite if any of them is not: none cancels another.
        total = (
            abs(numbers.x_m) + abs(numbers.y_m) + abs(numbers.heading_rad) + abs(numbers.speed_mps)
        )
        largest = max(total, abs(numbers.length_m), abs(numbers.width_m))
        # numpy's float32 would be summed in single precision by the interpreter alone.
        if not (isinstance(total, (float, int)) and fits_float32(largest)):
            raise SimulatorError(
                f"After step {observation.step} the simulator shows {vehicle}.",
                f"Every position, heading, speed and size must be a finite float {RANGE}.",
            )
    _check_control(observation.control, "`control`", observation.step)
    _check_control(observation.applied, "`applied`", observation.step)
    if observation.perceived is not None:
        _refuse_lost(observation.perceived, "`perceived`", observation.step)
    peak_mps2 = observation.peak_braking_mps2
    if peak_mps2 is not None and not 0.0 < peak_mps2 <= LARGEST_FLOAT32:
        problem = f"`peak_braking_mps2` is {peak_mps2:g}."
        raise SimulatorError(problem, "State a finite number above 0, or leave it out.")


def _check_control(control: Control | None, name: str, step: int) -> None:
    if control is not None:
        _refuse_lost((control.acceleration_mps2, control.steering_rad), name, step)


def _refuse_lost(numbers: Sequence[float], name: str, step: int) -> None:
    """Refuse finite numbers that would become infinite if they are kept, as float32."""
    for number in numbers:
        if LARGEST_FLOAT32 < abs(number) < inf:
            problem = f"After step {step} {name} holds {number:g}."
            raise SimulatorError(problem, f"Numbers of an episode must be {RANGE}.")


def _place_vehicles(course: Sequence[Observation]) -> tuple[Floats, Floats]:
    """Return poses, shape (observations, vehicles, 4), and sizes, shape (vehicles, 2), of a course.

    Vehicle 0 is the ego. The pose of an absent vehicle is NaN. Its size is taken from its first
    observation.

    Raises:
        SimulatorError: vehicles without numbers come or go.
    """
    if len({len(seen.others) for seen in course if seen.ids is None}) > 1:
        problem = "The number of vehicles changes during the episode."
        raise SimulatorError(problem, "Give each a number that it keeps: `Observation.ids`.")
    last = max([max(seen.numbers) for seen in course])
    vehicles = np.full((len(course), last + 1, 4), np.nan, np.float32)
    sizes: dict[int, tuple[float, float]] = {}
    for row, seen in zip(vehicles, course, strict=True):
        for number, vehicle in zip((0, *seen.numbers), (seen.ego, *seen.others), strict=True):
            row[number] = vehicle.x_m, vehicle.y_m, vehicle.heading_rad, vehicle.speed_mps
            sizes.setdefault(number, (vehicle.length_m, vehicle.width_m))
    # A simulator may leave out numbers: NaN is the size of a vehicle that was never there.
    return vehicles, np.array([sizes.get(each, (nan, nan)) for each in range(last + 1)], np.float32)


def compute_severity(observation: Observation) -> float:
    """Return ||v_ego - v_actor||² for the vehicle that was struck. [m²/s²]"""
    vx, vy = velocity(observation.ego)
    others = observation.others
    other_vx, other_vy = velocity(others[find_struck(observation.ego, others)])
    return (vx - other_vx) ** 2 + (vy - other_vy) ** 2


def _time_s(step: int | None, dt_s: float) -> float | None:
    return None if step is None else step * dt_s


def _to_array(rows: Sequence[Row], columns: int) -> Floats:
    """Return an array of shape (rows, columns), also for no rows."""
    return np.array(rows, np.float32).reshape(-1, columns)
