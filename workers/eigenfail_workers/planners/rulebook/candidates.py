"""Candidates of the truck's behaviour over a long horizon, rolled out as longitudinal profiles."""

from collections.abc import Callable
from typing import Final

from eigenfail_workers.planners.rulebook.settings import CandidateSettings, TruckLimits
from eigenfail_workers.planners.rulebook.traffic import needed_deceleration
from eigenfail_workers.planners.rulebook.values import Neighbour, PlanStart, Profile, Traffic


def limit_change(wanted: float, now: float, largest_change: float) -> float:
    """Return `wanted`, limited to the largest change from `now`."""
    return min(max(wanted, now - largest_change), now + largest_change)


KNOTS: Final = 10
KNOT_S: Final = 0.5
"""The horizon: ten knots, five seconds."""


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
    # A truck that is already faster than its target may brake gently: it is not slowed down at
    # once.
    fastest = max(speed, start.task.target_mps)
    for _ in range(KNOTS):
        acceleration = limit_change(target_mps2, acceleration, change)
        # The accelerations that are handed on are those that the clipped speeds have.
        reached = min(max(speed + acceleration * KNOT_S, 0.0), fastest)
        way += 0.5 * (speed + reached) * KNOT_S
        accelerations.append((reached - speed) / KNOT_S)
        ways.append(way)
        speeds.append(reached)
        speed = reached
    return Profile(name, target_mps2, accelerations, ways, speeds)
