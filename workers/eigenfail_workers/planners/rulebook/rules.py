"""The hierarchy of rules: candidates are compared by the first rule on which they differ.

No collision > right of way > clearance > end of the lane and speed limit > comfort > progress. A
rule gives each candidate a cost; those within its tolerance of the best go on to the next rule.
"""

from collections.abc import Callable, Sequence
from typing import Annotated

import msgspec
from msgspec import Meta

from eigenfail_workers.planners.rulebook.candidates import KNOT_S, KNOTS, Profile
from eigenfail_workers.planners.rulebook.surroundings import (
    Neighbour,
    Surroundings,
    needed_deceleration,
)

UNOPPOSED = "unopposed"
"""Stands for the deciding rule where no rule told the candidates apart."""


DEAD_END_M = 1000.0
"""Stands for the way that is lost in a lane that ends: more than anybody makes in the horizon."""


class RuleSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Where the rules begin to bite.

    Attributes:
        lead_margin_m: gap that a lead is owed.
        lead_need_mps2: required deceleration that is nothing to react to yet.
        neighbour_margin_m: gap that a slower neighbour is owed.
        neighbour_need_mps2: required deceleration behind a slower neighbour from which the truck
            drops back before it is asked to: the defensive rule.
        turning_room_m: room before the end of the lane that a truck needs to leave it yet.
        lane_end_need_mps2: required deceleration before the end of the lane from which it brakes.
        comfort_mps2: acceleration beyond which a candidate is uncomfortable.
    """

    lead_margin_m: Annotated[float, Meta(ge=0.0, le=30.0)] = 5.0
    lead_need_mps2: Annotated[float, Meta(ge=0.0, le=5.0)] = 0.2
    neighbour_margin_m: Annotated[float, Meta(ge=0.0, le=50.0)] = 10.0
    neighbour_need_mps2: Annotated[float, Meta(ge=0.0, le=5.0)] = 1.0
    turning_room_m: Annotated[float, Meta(ge=0.0, le=200.0)] = 60.0
    lane_end_need_mps2: Annotated[float, Meta(ge=0.0, le=5.0)] = 2.2
    comfort_mps2: Annotated[float, Meta(gt=0.0, le=7.0)] = 2.5


class Question(msgspec.Struct, frozen=True):
    """What the rules judge by."""

    around: Surroundings
    speed_mps: float
    speed_limit_mps: float
    settings: RuleSettings


class Rule(msgspec.Struct, frozen=True):
    """One rule: a cost, and the difference in it that counts as none."""

    name: str
    cost: Callable[[Profile, Question], float]
    tolerance: float = 0.0


class Verdict(msgspec.Struct, frozen=True):
    """The chosen candidate, and the rule that turned the last rival down."""

    profile: Profile
    rule: str


def collision(profile: Profile, question: Question) -> float:
    """Speed at which the candidate would run into the lead within the horizon [m/s].

    For a change of lane, too, that at which who is behind would run into the truck.
    """
    lead = question.around.lead
    if profile.change is not None and profile.change.hit_mps > 0.0:
        return profile.change.hit_mps
    if lead is None:
        return 0.0
    for knot in range(KNOTS):
        if lead.gap_m + lead.speed_mps * KNOT_S * (knot + 1) <= profile.ways[knot]:
            return max(profile.speeds[knot] - lead.speed_mps, 0.1)
    return 0.0


def right_of_way(profile: Profile, question: Question) -> float:
    """How much harder than now the lead would make the truck brake a second later [m/s²].

    Behind a lead that brakes nothing may be left for later.
    For a change of lane, too, how much is missing of what is owed to who is behind [m].
    """
    lead, settings = question.around.lead, question.settings
    change = profile.change
    if change is not None and change.begins is not None and change.short_behind_m > 0.0:
        return change.short_behind_m
    if lead is None:
        return 0.0
    owed, margin_m = settings.lead_need_mps2, settings.lead_margin_m
    if not lead.is_braking:
        now = needed_deceleration(lead, lead.gap_m, question.speed_mps, margin_m)
        owed = max(now, owed)
    return max(_need_later(profile, lead, margin_m) - owed, 0.0)


def clearance(profile: Profile, question: Question) -> float:
    """By how much the need to drop back behind a slower neighbour would be overdue [m/s²].

    For a change of lane, too, how much is missing of what is owed to who is ahead [m].
    """
    neighbour, settings = question.around.neighbour, question.settings
    change = profile.change
    if change is not None and change.begins is not None and change.short_ahead_m > 0.0:
        return change.short_ahead_m
    if neighbour is None:
        return 0.0
    margin_m = settings.neighbour_margin_m
    now = needed_deceleration(neighbour, neighbour.gap_m, question.speed_mps, margin_m)
    owed = max(now, settings.neighbour_need_mps2)
    return max(_need_later(profile, neighbour, margin_m) - owed, 0.0)


def lane_end(profile: Profile, question: Question) -> float:
    """By how much the need to brake before the end of the lane would be overdue [m/s²].

    For a change of lane that begins now, how far beyond that end it would be over [m].
    """
    end, settings = question.around.lane_end, question.settings
    if end is None:
        return 0.0
    if profile.change is not None and profile.change.begins == 0:
        return max(profile.change.over_m - end.gap_m, 0.0)
    margin_m = settings.turning_room_m
    now = needed_deceleration(end, end.gap_m, question.speed_mps, margin_m)
    return max(_need_later(profile, end, margin_m) - max(now, settings.lane_end_need_mps2), 0.0)


def speed_limit(profile: Profile, question: Question) -> float:
    """By how much the candidate ends above the limit [m/s]."""
    return max(profile.speeds[-1] - question.speed_limit_mps, 0.0)


def comfort(profile: Profile, question: Question) -> float:
    """By how much it accelerates or brakes beyond what is comfortable [m/s²]."""
    return max(abs(profile.target_mps2) - question.settings.comfort_mps2, 0.0)


def progress(profile: Profile, question: Question) -> float:
    """The way not made, relative to any other [m].

    In a lane that ends every second counts as lost until a change of lane begins. A change that
    would be over too late is worse than any other, one that is not in sight is worse than that,
    and staying in the lane is worst.
    """
    end, change = question.around.lane_end, profile.change
    if end is None:
        return -profile.ways[-1]
    if change is None:
        return 3.0 * DEAD_END_M - profile.ways[-1]
    if change.begins is None:
        return 2.0 * DEAD_END_M + change.short_ahead_m + change.short_behind_m
    waiting_m = change.begins * KNOT_S * question.speed_limit_mps
    too_late_m = DEAD_END_M if change.over_m > end.gap_m else 0.0
    return too_late_m + waiting_m - profile.ways[-1]


def _need_later(profile: Profile, other: Neighbour, margin_m: float) -> float:
    """Required deceleration at the end of the second knot, the other's speed unchanged [m/s²]."""
    gap_m = other.gap_m + 2.0 * KNOT_S * other.speed_mps - profile.ways[1]
    return needed_deceleration(other, gap_m, profile.speeds[1], margin_m)


HIERARCHY = (
    Rule("no_collision", collision, 0.1),
    Rule("right_of_way", right_of_way, 0.02),
    Rule("clearance", clearance, 0.02),
    Rule("lane_end", lane_end, 0.02),
    Rule("speed_limit", speed_limit, 0.1),
    Rule("comfort", comfort, 0.05),
    Rule("progress", progress),
)


def choose(
    profiles: Sequence[Profile], question: Question, hierarchy: Sequence[Rule] = HIERARCHY
) -> Verdict:
    """The best candidate in lexicographic order; the first listed among equals."""
    left, decided = list(profiles), UNOPPOSED
    for rule in hierarchy:
        if len(left) == 1:
            break
        costs = [rule.cost(profile, question) for profile in left]
        bar = min(costs) + rule.tolerance
        kept = [profile for profile, cost in zip(left, costs, strict=True) if cost <= bar]
        decided = rule.name if len(kept) < len(left) else decided
        left = kept
    return Verdict(left[0], decided)
