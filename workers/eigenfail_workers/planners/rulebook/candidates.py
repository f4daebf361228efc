"""Candidates of the truck's behaviour over a long horizon, rolled out as longitudinal profiles."""

from collections.abc import Callable
from math import inf
from typing import Annotated

import msgspec
from msgspec import Meta

from eigenfail_workers.planners.rulebook.driving_modes import Task
from eigenfail_workers.planners.rulebook.traffic import (
    Neighbour,
    Traffic,
    needed_deceleration,
)


class TruckLimits(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Limits of the truck's acceleration and jerk.

    Attributes:
        peak_braking_mps2: deceleration of an emergency stop.
        comfort_braking_mps2: largest planned deceleration.
        comfort_jerk_mps3: largest planned jerk.
        emergency_jerk_mps3: largest jerk in an emergency.
    """

    peak_braking_mps2: Annotated[float, Meta(gt=0.0, le=10.0)] = 7.0
    comfort_braking_mps2: Annotated[float, Meta(gt=0.0, le=7.0)] = 4.0
    comfort_jerk_mps3: Annotated[float, Meta(gt=0.0, le=20.0)] = 4.0
    emergency_jerk_mps3: Annotated[float, Meta(gt=0.0, le=50.0)] = 15.0


def limit_change(wanted: float, now: float, largest_change: float) -> float:
    """Return `wanted`, limited to the largest change from `now`."""
    return min(max(wanted, now - largest_change), now + largest_change)


KNOTS = 10
KNOT_S = 0.5
"""The horizon: ten knots, five seconds."""


class CandidateSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How candidates are shaped.

    Attributes:
        lead_margin_m: least gap to a lead.
        lead_headway_s: time headway at which a lead is followed.
        headway_gain_per_s2: gain at which a missing headway is restored.
        neighbour_margin_m: least gap to a slower neighbour, which may change into the lane.
        neighbour_braking_mps2: largest deceleration behind a neighbour.
        speed_gain_per_s: gain at which the target speed is approached.
        turning_room_m: distance to the end of the lane at which the truck stops.
    """

    lead_margin_m: Annotated[float, Meta(ge=0.0, le=30.0)] = 5.0
    lead_headway_s: Annotated[float, Meta(ge=0.0, le=5.0)] = 1.0
    headway_gain_per_s2: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.04
    neighbour_margin_m: Annotated[float, Meta(ge=0.0, le=50.0)] = 10.0
    neighbour_braking_mps2: Annotated[float, Meta(gt=0.0, le=7.0)] = 1.5
    speed_gain_per_s: Annotated[float, Meta(gt=0.0, le=5.0)] = 0.4
    turning_room_m: Annotated[float, Meta(ge=0.0, le=200.0)] = 60.0


class PlanStart(msgspec.Struct, frozen=True, gc=False):
    """State of the truck when it decides: speed, present acceleration, and task."""

    speed_mps: float
    acceleration_mps2: float
    task: Task


class LaneChange(msgspec.Struct, frozen=True):
    """Lateral part of a candidate: a change into a gap of the next lane.

    Attributes:
        begins: knot at which the change begins, 0 for now; None if the gap fits at no knot.
        short_ahead_m: length that the gap lacks ahead of the truck: the largest one after the
            begin; without a begin, that at the last knot.
        short_behind_m: length that the gap lacks behind the truck, likewise.
        over_m: way to the end of the change.
        hit_mps: speed at which the vehicle behind would run into the truck.
    """

    begins: int | None = None
    short_ahead_m: float = 0.0
    short_behind_m: float = 0.0
    over_m: float = inf
    hit_mps: float = 0.0


class Profile(msgspec.Struct, frozen=True):
    """A candidate, rolled out over the horizon.

    Attributes:
        name: name of the candidate.
        target_mps2: acceleration that it approaches.
        accelerations: over each of the knots [m/s²].
        ways: distance covered at the end of each knot [m].
        speeds: speed at the end of each knot [m/s].
        change: lateral part; None for a candidate that stays in its lane.
    """

    name: str
    target_mps2: float
    accelerations: list[float]
    ways: list[float]
    speeds: list[float]
    change: LaneChange | None = None


Target = Callable[[PlanStart, Traffic, CandidateSettings], float | None]


def keep(start: PlanStart, _traffic: Traffic, settings: CandidateSettings) -> float:
    """Return the acceleration that approaches the target speed."""
    wanted = settings.speed_gain_per_s * (start.task.target_mps - start.speed_mps)
    return float(min(wanted, start.task.max_acceleration_mps2))


def hold(start: PlanStart, _traffic: Traffic, settings: CandidateSettings) -> float:
    """Return the deceleration that approaches the target speed, without accelerating."""
    return min(keep(start, _traffic, settings), 0.0)


def slow(start: PlanStart, traffic: Traffic, settings: CandidateSettings) -> float | None:
    """Return the deceleration that drops back behind a slower neighbour, before it merges."""
    if traffic.neighbour is None:
        return None
    need = _need(start, traffic.neighbour, settings.neighbour_margin_m)
    return -min(need, settings.neighbour_braking_mps2)


def follow(start: PlanStart, traffic: Traffic, settings: CandidateSettings) -> float | None:
    """Return the deceleration that keeps the margin to the lead and restores the headway."""
    lead = traffic.lead
    if lead is None:
        return None
    need = _need(start, lead, settings.lead_margin_m)
    headway_m = settings.lead_margin_m + settings.lead_headway_s * start.speed_mps
    return min(settings.headway_gain_per_s2 * (lead.gap_m - headway_m), 0.0) - need


def stop(start: PlanStart, traffic: Traffic, settings: CandidateSettings) -> float | None:
    """Return the deceleration that stops before the end of the lane."""
    if traffic.lane_end is None:
        return None
    return -_need(start, traffic.lane_end, settings.turning_room_m)


def _need(start: PlanStart, other: Neighbour, margin_m: float) -> float:
    return needed_deceleration(other, other.gap_m, start.speed_mps, margin_m)


CANDIDATES: dict[str, Target] = {
    "keep": keep,
    "hold": hold,
    "slow": slow,
    "follow": follow,
    "stop": stop,
}
"""Candidates that stay in their lane, in the order of preference among equals."""


def roll_out_all(
    start: PlanStart, traffic: Traffic, settings: CandidateSettings, limits: TruckLimits
) -> list[Profile]:
    """Return the profiles of all candidates that stay in their lane, as far as they apply."""
    found = []
    for name, target in CANDIDATES.items():
        wanted = target(start, traffic, settings)
        if wanted is not None:
            found.append(roll_out(name, start, max(wanted, -limits.comfort_braking_mps2), limits))
    return found


def roll_out(name: str, start: PlanStart, target_mps2: float, limits: TruckLimits) -> Profile:
    """Return the profile that approaches an acceleration at comfortable jerk.

    It neither exceeds the target speed of the task nor drives backwards.
    """
    accelerations, ways, speeds = [], [], []
    change = limits.comfort_jerk_mps3 * KNOT_S
    speed, acceleration, way = start.speed_mps, start.acceleration_mps2, 0.0
    fastest = max(speed, start.task.target_mps)
    for _ in range(KNOTS):
        acceleration = limit_change(target_mps2, acceleration, change)
        reached = min(max(speed + acceleration * KNOT_S, 0.0), fastest)
        way += 0.5 * (speed + reached) * KNOT_S
        accelerations.append((reached - speed) / KNOT_S)
        ways.append(way)
        speeds.append(reached)
        speed = reached
    return Profile(name, target_mps2, accelerations, ways, speeds)
