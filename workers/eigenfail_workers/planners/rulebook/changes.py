"""Changes of lane as candidates: a longitudinal profile into a gap, and a lateral one once it fits.

A gap fits while it is as long as what is owed in it, both ahead and behind:

    owed = margin + headway · v_rear + max(v_rear − v_front, 0)² / (2 b)

with v_rear, v_front the speeds of the rear and the front one of the two, and b the braking that
the rear one may be made to do.
"""

from collections.abc import Sequence
from typing import Annotated, NamedTuple

import msgspec
from msgspec import Meta

from eigenfail_workers.planners.rulebook.candidates import (
    KNOT_S,
    KNOTS,
    CandidateSettings,
    Change,
    Profile,
    Start,
)
from eigenfail_workers.planners.rulebook.driving_modes import Task
from eigenfail_workers.planners.rulebook.lateral import LateralSettings, change_way_m
from eigenfail_workers.planners.rulebook.surroundings import Gap, Neighbour
from eigenfail_workers.planners.rulebook.truck import TruckLimits, towards

LOOK_KNOTS = 32
"""How far ahead a gap is looked for that does not fit yet: sixteen seconds."""

Pair = tuple[float, float]
Metres = Annotated[float, Meta(ge=0.0, le=100.0)]
Seconds = Annotated[float, Meta(ge=0.0, le=5.0)]
Braking = Annotated[float, Meta(gt=0.0, le=7.0)]


class Owed(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What is owed between two vehicles, one behind the other."""

    margin_m: Metres
    headway_s: Seconds
    braking_mps2: Braking

    def gap_m(self, rear_mps: float, front_mps: float) -> float:
        """The gap that is owed at these speeds [m]."""
        closing = max(rear_mps - front_mps, 0.0)
        return self.margin_m + self.headway_s * rear_mps + closing**2 / (2.0 * self.braking_mps2)


class Moment(NamedTuple):
    """The truck at the end of a knot: way from now, speed, acceleration, and the one wanted."""

    way_m: float
    speed_mps: float
    acceleration_mps2: float
    wanted_mps2: float


class ChangeSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """When a gap fits, and how the truck gets beside it.

    Attributes:
        ahead: owed by the truck to who is ahead in the gap.
        behind: left to who is behind; little braking, as nobody need make room for a truck.
        begun_share: share of it that is still asked for once the change has begun.
        spare_m: the truck makes for a gap with this much more than what is owed.
        gap_gain_per_s2: how eagerly a missing distance is made up for.
        speed_gain_per_s: how eagerly the speed of who is ahead is taken on.
        braking_mps2: hardest braking to get beside a gap.
    """

    ahead: Owed = Owed(margin_m=5.0, headway_s=0.6, braking_mps2=1.5)
    behind: Owed = Owed(margin_m=4.0, headway_s=0.4, braking_mps2=0.5)
    begun_share: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.5
    spare_m: Metres = 3.0
    gap_gain_per_s2: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.09
    speed_gain_per_s: Annotated[float, Meta(ge=0.0, le=5.0)] = 0.6
    braking_mps2: Braking = 2.0
    lateral: LateralSettings = LateralSettings()


class ChangePlanner:
    """Rolls out changes of lane."""

    def __init__(
        self, settings: ChangeSettings, candidates: CandidateSettings, limits: TruckLimits
    ) -> None:
        self._settings = settings
        self._candidates = candidates
        self._limits = limits

    def planned(self, name: str, gap: Gap, start: Start) -> Profile:
        """A change that begins at the first knot from which on the gap fits."""
        course = self._approach(gap.ahead, start, LOOK_KNOTS)
        short = self._short(gap, course, 1.0)
        begins = len(course)
        while begins > 0 and max(short[begins - 1]) <= 0.0:
            begins -= 1
        if begins == len(course):
            change = Change(short_ahead_m=short[-1][0], short_behind_m=short[-1][1])
        else:
            there = course[begins]
            over_m = there.way_m + change_way_m(there.speed_mps, self._settings.lateral)
            change = Change(begins=begins, over_m=over_m)
        return _profile(name, course, change)

    def begun(self, name: str, gap: Gap, start: Start, left_m: float) -> Profile:
        """The change that is under way, and over in so many metres."""
        course = self._approach(gap.ahead, start, KNOTS)
        short = self._short(gap, course, self._settings.begun_share)
        change = Change(
            begins=0,
            short_ahead_m=max(ahead for ahead, _ in short),
            short_behind_m=max(behind for _, behind in short),
            over_m=left_m,
            hit_mps=_hit_mps(gap.behind, course),
        )
        return _profile(name, course, change)

    def _approach(self, ahead: Neighbour | None, start: Start, knots: int) -> list[Moment]:
        """Seek speed and distance of who is ahead in the gap; of nobody, the task's speed."""
        largest = self._limits.comfort_jerk_mps3 * KNOT_S
        now = Moment(0.0, start.speed_mps, start.acceleration_mps2, 0.0)
        course = [now]
        for knot in range(knots):
            wanted = self._wanted(ahead, start.task, now, knot * KNOT_S)
            acceleration = towards(wanted, now.acceleration_mps2, largest)
            speed = max(now.speed_mps + acceleration * KNOT_S, 0.0)
            way = now.way_m + 0.5 * (now.speed_mps + speed) * KNOT_S
            now = Moment(way, speed, acceleration, wanted)
            course.append(now)
        return course

    def _wanted(self, ahead: Neighbour | None, task: Task, now: Moment, time_s: float) -> float:
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

    def _short(self, gap: Gap, course: Sequence[Moment], share: float) -> list[Pair]:
        """What is missing at each knot of a share of what is owed, ahead and behind [m]."""
        owed, missing = self._settings, []
        for knot, now in enumerate(course):
            ahead_m = behind_m = 0.0
            if (car := gap.ahead) is not None:
                there_m = car.gap_m + car.speed_mps * KNOT_S * knot - now.way_m
                ahead_m = share * owed.ahead.gap_m(now.speed_mps, car.speed_mps) - there_m
            if (car := gap.behind) is not None:
                there_m = car.gap_m - car.speed_mps * KNOT_S * knot + now.way_m
                behind_m = share * owed.behind.gap_m(car.speed_mps, now.speed_mps) - there_m
            missing.append((max(ahead_m, 0.0), max(behind_m, 0.0)))
        return missing


def _hit_mps(behind: Neighbour | None, course: Sequence[Moment]) -> float:
    """The speed at which who is behind would run into the truck; 0 if it would not."""
    if behind is None:
        return 0.0
    for knot, now in enumerate(course):
        if behind.gap_m + now.way_m <= behind.speed_mps * KNOT_S * knot:
            return max(behind.speed_mps - now.speed_mps, 0.1)
    return 0.0


def _profile(name: str, course: Sequence[Moment], change: Change) -> Profile:
    """A candidate has the horizon of all candidates, however far its approach was looked at."""
    horizon = course[1 : KNOTS + 1]
    return Profile(
        name=name,
        target_mps2=horizon[0].wanted_mps2,
        accelerations=[now.acceleration_mps2 for now in horizon],
        ways=[now.way_m for now in horizon],
        speeds=[now.speed_mps for now in horizon],
        change=change,
    )
