"""The hierarchy of rules: candidates are compared by the first rule on which they differ.

No collision > right of way > clearance > speed limit > comfort > progress. A rule gives each
candidate a cost; those within its tolerance of the best go on to the next rule.
"""

from collections.abc import Callable, Sequence
from typing import Annotated

import msgspec
from msgspec import Meta

from eigenfail_workers.planners.rulebook.candidates import KNOT_S, KNOTS, Profile
from eigenfail_workers.planners.rulebook.surroundings import (
    Neighbour,
    Surroundings,
    required_deceleration,
)

UNOPPOSED = "unopposed"
"""Stands for the deciding rule where no rule told the candidates apart."""


class RuleSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Where the rules begin to bite.

    Attributes:
        lead_margin_m: gap that a lead is owed.
        lead_need_mps2: required deceleration that is nothing to react to yet.
        neighbour_margin_m: gap that a slower neighbour is owed.
        neighbour_need_mps2: required deceleration behind a slower neighbour from which the truck
            drops back before it is asked to: the defensive rule.
        comfort_mps2: acceleration beyond which a candidate is uncomfortable.
    """

    lead_margin_m: Annotated[float, Meta(ge=0.0, le=30.0)] = 5.0
    lead_need_mps2: Annotated[float, Meta(ge=0.0, le=5.0)] = 0.2
    neighbour_margin_m: Annotated[float, Meta(ge=0.0, le=50.0)] = 10.0
    neighbour_need_mps2: Annotated[float, Meta(ge=0.0, le=5.0)] = 1.0
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
    """Speed at which the candidate would run into the lead within the horizon [m/s]."""
    lead = question.around.lead
    if lead is None:
        return 0.0
    for knot in range(KNOTS):
        if lead.gap_m + lead.speed_mps * KNOT_S * (knot + 1) <= profile.ways[knot]:
            return max(profile.speeds[knot] - lead.speed_mps, 0.1)
    return 0.0


def right_of_way(profile: Profile, question: Question) -> float:
    """How much harder than now the lead would make the truck brake a second later [m/s²]."""
    lead, settings = question.around.lead, question.settings
    if lead is None:
        return 0.0
    margin_m = settings.lead_margin_m
    now = required_deceleration(lead.gap_m, question.speed_mps - lead.speed_mps, margin_m)
    return max(_need_later(profile, lead, margin_m) - max(now, settings.lead_need_mps2), 0.0)


def clearance(profile: Profile, question: Question) -> float:
    """By how much the need to drop back behind a slower neighbour would be overdue [m/s²]."""
    neighbour, settings = question.around.neighbour, question.settings
    if neighbour is None:
        return 0.0
    margin_m = settings.neighbour_margin_m
    now = required_deceleration(neighbour.gap_m, question.speed_mps - neighbour.speed_mps, margin_m)
    owed = max(now, settings.neighbour_need_mps2)
    return max(_need_later(profile, neighbour, margin_m) - owed, 0.0)


def speed_limit(profile: Profile, question: Question) -> float:
    """By how much the candidate ends above the limit [m/s]."""
    return max(profile.speeds[-1] - question.speed_limit_mps, 0.0)


def comfort(profile: Profile, question: Question) -> float:
    """By how much it accelerates or brakes beyond what is comfortable [m/s²]."""
    return max(abs(profile.target_mps2) - question.settings.comfort_mps2, 0.0)


def progress(profile: Profile, _question: Question) -> float:
    """The way not made, relative to any other [m]."""
    return -profile.ways[-1]


def _need_later(profile: Profile, other: Neighbour, margin_m: float) -> float:
    """Required deceleration at the end of the second knot, the other's speed unchanged [m/s²]."""
    gap_m = other.gap_m + 2.0 * KNOT_S * other.speed_mps - profile.ways[1]
    return required_deceleration(gap_m, profile.speeds[1] - other.speed_mps, margin_m)


HIERARCHY = (
    Rule("no_collision", collision, 0.1),
    Rule("right_of_way", right_of_way, 0.02),
    Rule("clearance", clearance, 0.02),
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
