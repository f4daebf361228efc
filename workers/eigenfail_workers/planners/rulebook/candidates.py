"""Long-horizon candidates: what the truck could do, each rolled out as a longitudinal profile."""

from collections.abc import Callable
from math import inf
from typing import Annotated

import msgspec
from msgspec import Meta

from eigenfail_workers.planners.rulebook.driving_modes import Task
from eigenfail_workers.planners.rulebook.surroundings import (
    Neighbour,
    Surroundings,
    needed_deceleration,
)
from eigenfail_workers.planners.rulebook.truck import TruckLimits, towards

KNOTS = 10
KNOT_S = 0.5
"""The horizon: ten knots, five seconds."""


class CandidateSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How candidates are shaped.

    Attributes:
        lead_margin_m: a lead is approached no nearer than this.
        lead_headway_s: and followed at this headway.
        headway_gain_per_s2: how eagerly a missing headway is restored.
        neighbour_margin_m: the same margin for a slower neighbour that may yet come over.
        neighbour_braking_mps2: hardest braking for a neighbour.
        speed_gain_per_s: how eagerly the target speed is sought.
        turning_room_m: the truck stops this long before its lane ends, to be able to leave it yet.
    """

    lead_margin_m: Annotated[float, Meta(ge=0.0, le=30.0)] = 5.0
    lead_headway_s: Annotated[float, Meta(ge=0.0, le=5.0)] = 1.0
    headway_gain_per_s2: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.04
    neighbour_margin_m: Annotated[float, Meta(ge=0.0, le=50.0)] = 10.0
    neighbour_braking_mps2: Annotated[float, Meta(gt=0.0, le=7.0)] = 1.5
    speed_gain_per_s: Annotated[float, Meta(gt=0.0, le=5.0)] = 0.4
    turning_room_m: Annotated[float, Meta(ge=0.0, le=200.0)] = 60.0


class Start(msgspec.Struct, frozen=True, gc=False):
    """Where the truck is when it decides: speed, the acceleration it has, and its task."""

    speed_mps: float
    acceleration_mps2: float
    task: Task


class Change(msgspec.Struct, frozen=True):
    """The lateral part of a candidate: a change into a gap of the next lane.

    Attributes:
        begins: knot at which it begins, 0 for now; None if none is in sight at which the gap fits.
        short_ahead_m: by how much the gap is too short ahead of the truck, at worst from then on;
            if it does not begin, at last. short_behind_m: the same behind the truck.
        over_m: way until it is over.
        hit_mps: speed at which who is behind would run into the truck.
    """

    begins: int | None = None
    short_ahead_m: float = 0.0
    short_behind_m: float = 0.0
    over_m: float = inf
    hit_mps: float = 0.0


class Profile(msgspec.Struct, frozen=True):
    """A candidate and where it leads.

    Attributes:
        name: of the candidate.
        target_mps2: acceleration that it settles at.
        accelerations: over each of the knots [m/s²].
        ways: covered at the end of each knot [m].
        speeds: at the end of each knot [m/s].
        change: its lateral part; None if it stays in its lane.
    """

    name: str
    target_mps2: float
    accelerations: list[float]
    ways: list[float]
    speeds: list[float]
    change: Change | None = None


Target = Callable[[Start, Surroundings, CandidateSettings], float | None]


def keep(start: Start, _around: Surroundings, settings: CandidateSettings) -> float:
    """Seek the target speed."""
    wanted = settings.speed_gain_per_s * (start.task.target_mps - start.speed_mps)
    return float(min(wanted, start.task.max_acceleration_mps2))


def hold(start: Start, _around: Surroundings, settings: CandidateSettings) -> float:
    """Do not accelerate."""
    return min(keep(start, _around, settings), 0.0)


def slow(start: Start, around: Surroundings, settings: CandidateSettings) -> float | None:
    """Drop back behind a slower neighbour, before it asks for it."""
    if around.neighbour is None:
        return None
    need = _need(start, around.neighbour, settings.neighbour_margin_m)
    return -min(need, settings.neighbour_braking_mps2)


def follow(start: Start, around: Surroundings, settings: CandidateSettings) -> float | None:
    """Yield to the lead: end the closing at its margin, and restore the headway."""
    lead = around.lead
    if lead is None:
        return None
    need = _need(start, lead, settings.lead_margin_m)
    headway_m = settings.lead_margin_m + settings.lead_headway_s * start.speed_mps
    return min(settings.headway_gain_per_s2 * (lead.gap_m - headway_m), 0.0) - need


def stop(start: Start, around: Surroundings, settings: CandidateSettings) -> float | None:
    """Come to rest before the lane ends."""
    if around.lane_end is None:
        return None
    return -_need(start, around.lane_end, settings.turning_room_m)


def _need(start: Start, other: Neighbour, margin_m: float) -> float:
    return needed_deceleration(other, other.gap_m, start.speed_mps, margin_m)


CANDIDATES: dict[str, Target] = {
    "keep": keep,
    "hold": hold,
    "slow": slow,
    "follow": follow,
    "stop": stop,
}
"""Those that stay in their lane, in the order of preference among equals."""


def profiles(
    start: Start, around: Surroundings, settings: CandidateSettings, limits: TruckLimits
) -> list[Profile]:
    """All candidates that stay in their lane and that this situation offers."""
    found = []
    for name, target in CANDIDATES.items():
        wanted = target(start, around, settings)
        if wanted is not None:
            found.append(roll_out(name, start, max(wanted, -limits.comfort_braking_mps2), limits))
    return found


def roll_out(name: str, start: Start, target_mps2: float, limits: TruckLimits) -> Profile:
    """Go to the target acceleration at comfortable jerk; neither over the task's speed nor back."""
    accelerations, ways, speeds = [], [], []
    change = limits.comfort_jerk_mps3 * KNOT_S
    speed, acceleration, way = start.speed_mps, start.acceleration_mps2, 0.0
    fastest = max(speed, start.task.target_mps)
    for _ in range(KNOTS):
        acceleration = towards(target_mps2, acceleration, change)
        reached = min(max(speed + acceleration * KNOT_S, 0.0), fastest)
        way += 0.5 * (speed + reached) * KNOT_S
        accelerations.append((reached - speed) / KNOT_S)
        ways.append(way)
        speeds.append(reached)
        speed = reached
    return Profile(name, target_mps2, accelerations, ways, speeds)
