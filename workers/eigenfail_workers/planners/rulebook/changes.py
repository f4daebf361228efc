"""Lane changes as candidates: a longitudinal profile to a gap, and a lateral path into it.

A gap fits while the distances to the vehicles ahead and behind are at least the required ones:

    required = margin + headway · v_rear + max(v_rear − v_front, 0)² / (2 b)

with v_rear, v_front the speeds of the rear and the front one of the two, and b the deceleration
that the rear one may be forced to.
"""

from collections.abc import Sequence
from typing import Annotated, NamedTuple

import msgspec
from msgspec import Meta

from eigenfail.values.disturbance import Pair
from eigenfail_workers.motion import minimum_jerk
from eigenfail_workers.planners.rulebook.candidates import (
    KNOT_S,
    KNOTS,
    CandidateSettings,
    LaneChange,
    PlanStart,
    Profile,
    TruckLimits,
    limit_change,
)
from eigenfail_workers.planners.rulebook.driving_modes import Task
from eigenfail_workers.planners.rulebook.traffic import Gap, Neighbour


class LateralSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How the truck changes lanes.

    Attributes:
        change_s: duration of a change at its initial speed.
        shortest_m: least length of a change, however slow the truck is.
    """

    change_s: Annotated[float, Meta(gt=0.0, le=20.0)] = 5.0
    shortest_m: Annotated[float, Meta(ge=35.0, le=200.0)] = 50.0


class LateralPath(msgspec.Struct, frozen=True, gc=False):
    """A path across the road; the lateral position is constant before and after it.

    It is a function of distance, not of time: a truck that brakes on it must not slide sideways.

    Attributes:
        from_m: lateral position before the path.
        to_m: lateral position after it.
        begins_x_m: position along the road at which it begins.
        length_m: along the road.
    """

    from_m: float
    to_m: float
    begins_x_m: float
    length_m: float

    def at(self, x_m: float) -> float:
        """Return the lateral position at a position along the road. [m]"""
        share = min(max((x_m - self.begins_x_m) / self.length_m, 0.0), 1.0)
        return self.from_m + (self.to_m - self.from_m) * minimum_jerk(share)[0]

    def left_m(self, x_m: float) -> float:
        """Return the distance to the end of the path, negative beyond it. [m]"""
        return self.begins_x_m + self.length_m - x_m


def make_straight_path(y_m: float) -> LateralPath:
    """Return a path at a constant lateral position."""
    return LateralPath(y_m, y_m, 0.0, 1.0)


def change_way_m(speed_mps: float, settings: LateralSettings) -> float:
    """Length of a lane change that begins at a speed. [m]"""
    return max(speed_mps * settings.change_s, settings.shortest_m)


LOOK_KNOTS = 32
"""Horizon over which a gap may begin to fit: sixteen seconds."""

Metres = Annotated[float, Meta(ge=0.0, le=100.0)]
Seconds = Annotated[float, Meta(ge=0.0, le=5.0)]
Braking = Annotated[float, Meta(gt=0.0, le=7.0)]


class RequiredGap(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Required gap between two vehicles, one behind the other."""

    margin_m: Metres
    headway_s: Seconds
    braking_mps2: Braking

    def gap_m(self, rear_mps: float, front_mps: float) -> float:
        """Required gap at two speeds. [m]"""
        closing = max(rear_mps - front_mps, 0.0)
        return self.margin_m + self.headway_s * rear_mps + closing**2 / (2.0 * self.braking_mps2)


class ApproachPoint(NamedTuple):
    """The truck at the end of a knot: distance, speed, acceleration, and wanted acceleration."""

    way_m: float
    speed_mps: float
    acceleration_mps2: float
    wanted_mps2: float


class ChangeSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """When a gap fits, and how the truck approaches it.

    Attributes:
        ahead: required gap to the vehicle ahead.
        behind: required gap to the vehicle behind, with little braking: it need not make room.
        begun_share: share of the required gaps that must remain after the change has begun.
        spare_m: distance that the approach adds to the required gap.
        gap_gain_per_s2: gain at which a missing distance is made up.
        speed_gain_per_s: gain at which the speed of the vehicle ahead is approached.
        braking_mps2: largest deceleration of the approach.
    """

    ahead: RequiredGap = RequiredGap(margin_m=5.0, headway_s=0.6, braking_mps2=1.5)
    behind: RequiredGap = RequiredGap(margin_m=4.0, headway_s=0.4, braking_mps2=0.5)
    begun_share: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.5
    spare_m: Metres = 3.0
    gap_gain_per_s2: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.09
    speed_gain_per_s: Annotated[float, Meta(ge=0.0, le=5.0)] = 0.6
    braking_mps2: Braking = 2.0
    lateral: LateralSettings = LateralSettings()


class ChangePlanner:
    """Rolls out lane changes."""

    def __init__(
        self, settings: ChangeSettings, candidates: CandidateSettings, limits: TruckLimits
    ) -> None:
        self._settings = settings
        self._candidates = candidates
        self._limits = limits

    def plan_change(self, name: str, gap: Gap, start: PlanStart) -> Profile:
        """Return a change that begins at the first knot from which on the gap fits."""
        course = self._approach(gap.ahead, start, LOOK_KNOTS)
        short = self._find_missing(gap, course, 1.0)
        begins = len(course)
        while begins > 0 and max(short[begins - 1]) <= 0.0:
            begins -= 1
        if begins == len(course):
            change = LaneChange(short_ahead_m=short[-1][0], short_behind_m=short[-1][1])
        else:
            there = course[begins]
            over_m = there.way_m + change_way_m(there.speed_mps, self._settings.lateral)
            change = LaneChange(begins=begins, over_m=over_m)
        return _profile(name, course, change)

    def continue_change(self, name: str, gap: Gap, start: PlanStart, left_m: float) -> Profile:
        """Return the rest of a change that has begun, and ends after `left_m`."""
        course = self._approach(gap.ahead, start, KNOTS)
        short = self._find_missing(gap, course, self._settings.begun_share)
        change = LaneChange(
            begins=0,
            short_ahead_m=max(ahead for ahead, _ in short),
            short_behind_m=max(behind for _, behind in short),
            over_m=left_m,
            hit_mps=_hit_mps(gap.behind, course),
        )
        return _profile(name, course, change)

    def _approach(
        self, ahead: Neighbour | None, start: PlanStart, knots: int
    ) -> list[ApproachPoint]:
        """Approach the distance and speed of the vehicle ahead; without one, the task's speed."""
        largest = self._limits.comfort_jerk_mps3 * KNOT_S
        now = ApproachPoint(0.0, start.speed_mps, start.acceleration_mps2, 0.0)
        course = [now]
        for knot in range(knots):
            wanted = self._wanted(ahead, start.task, now, knot * KNOT_S)
            acceleration = limit_change(wanted, now.acceleration_mps2, largest)
            speed = max(now.speed_mps + acceleration * KNOT_S, 0.0)
            way = now.way_m + 0.5 * (now.speed_mps + speed) * KNOT_S
            now = ApproachPoint(way, speed, acceleration, wanted)
            course.append(now)
        return course

    def _wanted(
        self, ahead: Neighbour | None, task: Task, now: ApproachPoint, time_s: float
    ) -> float:
        settings = self._settings
        free = self._candidates.speed_gain_per_s * (task.target_mps - now.speed_mps)
        free = min(free, task.max_acceleration_mps2)
        if ahead is None:
            return free
        gap_m = ahead.gap_m + ahead.speed_mps * time_s - now.way_m
        spare_m = gap_m - settings.ahead.gap_m(now.speed_mps, ahead.speed_mps) - settings.spare_m
        matched = settings.gap_gain_per_s2 * spare_m
        matched += settings.speed_gain_per_s * (ahead.speed_mps - now.speed_mps)
        return min(free, max(matched, -settings.braking_mps2))

    def _find_missing(self, gap: Gap, course: Sequence[ApproachPoint], share: float) -> list[Pair]:
        """Return what a share of the required gaps lacks ahead and behind, at each knot. [m]"""
        required, missing = self._settings, []
        for knot, now in enumerate(course):
            ahead_m = behind_m = 0.0
            if (car := gap.ahead) is not None:
                there_m = car.gap_m + car.speed_mps * KNOT_S * knot - now.way_m
                ahead_m = share * required.ahead.gap_m(now.speed_mps, car.speed_mps) - there_m
            if (car := gap.behind) is not None:
                there_m = car.gap_m - car.speed_mps * KNOT_S * knot + now.way_m
                behind_m = share * required.behind.gap_m(car.speed_mps, now.speed_mps) - there_m
            missing.append((max(ahead_m, 0.0), max(behind_m, 0.0)))
        return missing


def _hit_mps(behind: Neighbour | None, course: Sequence[ApproachPoint]) -> float:
    """Speed at which the vehicle behind would run into the truck; 0 if it would not. [m/s]"""
    if behind is None:
        return 0.0
    for knot, now in enumerate(course):
        if behind.gap_m + now.way_m <= behind.speed_mps * KNOT_S * knot:
            return max(behind.speed_mps - now.speed_mps, 0.1)
    return 0.0


def _profile(name: str, course: Sequence[ApproachPoint], change: LaneChange) -> Profile:
    """Return the profile over the horizon of all candidates, which is shorter than the approach."""
    horizon = course[1 : KNOTS + 1]
    return Profile(
        name=name,
        target_mps2=horizon[0].wanted_mps2,
        accelerations=[now.acceleration_mps2 for now in horizon],
        ways=[now.way_m for now in horizon],
        speeds=[now.speed_mps for now in horizon],
        change=change,
    )
