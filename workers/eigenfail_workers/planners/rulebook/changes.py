"""Lane changes as candidates: a longitudinal profile to a gap, and a lateral path into it.

A gap fits while the distances to the vehicles ahead and behind are at least the required ones:

    required = margin + headway · v_rear + max(v_rear − v_front, 0)² / (2 b)

with v_rear, v_front the speeds of the rear and the front one of the two, and b the deceleration
that the rear one may be forced to.
"""

from collections.abc import Sequence
from typing import Final, NamedTuple

from eigenfail.values.shapes import Pair
from eigenfail_workers.planners.rulebook import values
from eigenfail_workers.planners.rulebook.candidates import KNOT_S, KNOTS, limit_change
from eigenfail_workers.planners.rulebook.settings import (
    CandidateSettings,
    ChangeSettings,
    LateralSettings,
    TruckLimits,
)


def make_straight_path(y_m: float) -> values.LateralPath:
    """Return a path at a constant lateral position."""
    return values.LateralPath(y_m, y_m, 0.0, 1.0)


def change_way_m(speed_mps: float, settings: LateralSettings) -> float:
    """Length of a lane change that begins at a speed. [m]"""
    return max(speed_mps * settings.change_s, settings.shortest_m)


LOOK_KNOTS: Final = 32
"""Horizon over which a gap may begin to fit: sixteen seconds."""


class ApproachPoint(NamedTuple):
    """The truck at the end of a knot: distance, speed, acceleration, and wanted acceleration."""

    way_m: float
    speed_mps: float
    acceleration_mps2: float
    wanted_mps2: float


class ChangePlanner:
    """Rolls out lane changes."""

    def __init__(
        self, settings: ChangeSettings, candidates: CandidateSettings, limits: TruckLimits
    ) -> None:
        self._settings = settings
        self._candidates = candidates
        self._limits = limits

    def plan_change(self, name: str, gap: values.Gap, start: values.PlanStart) -> values.Profile:
        """Return a change that begins once the gap fits at a knot and at all later knots."""
        course = self._approach(gap.ahead, start, LOOK_KNOTS)
        short = self._find_missing(gap, course, 1.0)
        begins = len(course)
        # Backwards from the end: a gap that fits now and closes later does not fit.
        while begins > 0 and max(short[begins - 1]) <= 0.0:
            begins -= 1
        if begins == len(course):
            change = values.LaneChange(short_ahead_m=short[-1][0], short_behind_m=short[-1][1])
        else:
            there = course[begins]
            over_m = there.way_m + change_way_m(there.speed_mps, self._settings.lateral)
            change = values.LaneChange(begins=begins, over_m=over_m)
        return _profile(name, course, change)

    def continue_change(
        self, name: str, gap: values.Gap, start: values.PlanStart, left_m: float
    ) -> values.Profile:
        """Return the rest of a change that has begun, and ends after `left_m`."""
        course = self._approach(gap.ahead, start, KNOTS)
        short = self._find_missing(gap, course, self._settings.begun_share)
        change = values.LaneChange(
            begins=0,
            short_ahead_m=max(ahead for ahead, _ in short),
            short_behind_m=max(behind for _, behind in short),
            over_m=left_m,
            hit_mps=_hit_mps(gap.behind, course),
        )
        return _profile(name, course, change)

    def _approach(
        self, ahead: values.Neighbour | None, start: values.PlanStart, knots: int
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
        self, ahead: values.Neighbour | None, task: values.Task, now: ApproachPoint, time_s: float
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

    def _find_missing(
        self, gap: values.Gap, course: Sequence[ApproachPoint], share: float
    ) -> list[Pair]:
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


def _hit_mps(behind: values.Neighbour | None, course: Sequence[ApproachPoint]) -> float:
    """Speed at which the vehicle behind would run into the truck; 0 if it would not. [m/s]"""
    if behind is None:
        return 0.0
    for knot, now in enumerate(course):
        if behind.gap_m + now.way_m <= behind.speed_mps * KNOT_S * knot:
            # Not 0 even for a slow touch: 0 means no collision.
            return max(behind.speed_mps - now.speed_mps, 0.1)
    return 0.0


def _profile(
    name: str, course: Sequence[ApproachPoint], change: values.LaneChange
) -> values.Profile:
    """Return the profile over the horizon of all candidates, which is shorter than the approach."""
    horizon = course[1 : KNOTS + 1]
    return values.Profile(
        name=name,
        target_mps2=horizon[0].wanted_mps2,
        accelerations=[now.acceleration_mps2 for now in horizon],
        ways=[now.way_m for now in horizon],
        speeds=[now.speed_mps for now in horizon],
        change=change,
    )
