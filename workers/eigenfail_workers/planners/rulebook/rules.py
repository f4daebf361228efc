"""The hierarchy of rules: candidates are compared by the first rule on which they differ.

No collision > right of way > clearance > end of the lane and speed limit > comfort > progress. A
rule gives each candidate a cost; those within its tolerance of the best go on to the next rule.
"""

from collections.abc import Callable, Sequence
from typing import Final, NamedTuple

from eigenfail_workers.planners.rulebook import values
from eigenfail_workers.planners.rulebook.candidates import KNOT_S, KNOTS
from eigenfail_workers.planners.rulebook.traffic import needed_deceleration

UNOPPOSED = "unopposed"
"""Deciding rule where no rule distinguished the candidates."""

DEAD_END_M: Final = 1000.0
"""Distance that counts as lost in a lane that ends: more than any candidate covers."""


class Rule(NamedTuple):
    """One rule: a cost, and the difference in cost that it ignores."""

    name: str
    cost: Callable[[values.Profile, values.RuleContext], float]
    tolerance: float = 0.0


def collision(profile: values.Profile, context: values.RuleContext) -> float:
    """Speed at which the candidate would run into the lead within the horizon. [m/s]

    For a lane change also the speed at which the vehicle behind would run into the truck.
    """
    lead = context.traffic.lead
    if profile.change is not None and profile.change.hit_mps > 0.0:
        return profile.change.hit_mps
    if lead is None:
        return 0.0
    for knot in range(KNOTS):
        if lead.gap_m + lead.speed_mps * KNOT_S * (knot + 1) <= profile.ways[knot]:
            # Not 0 even for a slow touch: 0 means no collision.
            return max(profile.speeds[knot] - lead.speed_mps, 0.1)
    return 0.0


def right_of_way(profile: values.Profile, context: values.RuleContext) -> float:
    """Increase of the required deceleration behind the lead within one second. [m/s²]

    Behind a lead that brakes, all of the required deceleration counts. For a lane change, the
    length that the gap lacks behind the truck. [m]
    """
    lead, settings = context.traffic.lead, context.settings
    change = profile.change
    if change is not None and change.begins is not None and change.short_behind_m > 0.0:
        return change.short_behind_m
    if lead is None:
        return 0.0
    threshold, margin_m = settings.lead_need_mps2, settings.lead_margin_m
    if not lead.is_braking:
        now = needed_deceleration(lead, lead.gap_m, context.speed_mps, margin_m)
        # What the lead requires now is no fault of a candidate: only an increase costs.
        threshold = max(now, threshold)
    return max(_need_later(profile, lead, margin_m) - threshold, 0.0)


def clearance(profile: values.Profile, context: values.RuleContext) -> float:
    """Increase of the required deceleration behind a slower neighbour within a second. [m/s²]

    For a lane change, the length that the gap lacks ahead of the truck. [m]
    """
    neighbour, settings = context.traffic.neighbour, context.settings
    change = profile.change
    if change is not None and change.begins is not None and change.short_ahead_m > 0.0:
        return change.short_ahead_m
    if neighbour is None:
        return 0.0
    margin_m = settings.neighbour_margin_m
    now = needed_deceleration(neighbour, neighbour.gap_m, context.speed_mps, margin_m)
    threshold = max(now, settings.neighbour_need_mps2)
    return max(_need_later(profile, neighbour, margin_m) - threshold, 0.0)


def lane_end(profile: values.Profile, context: values.RuleContext) -> float:
    """Increase of the required deceleration before the end of the lane within a second. [m/s²]

    For a lane change that begins now, it is the distance that the change needs beyond the end of
    the lane. [m]
    """
    end, settings = context.traffic.lane_end, context.settings
    if end is None:
        return 0.0
    if profile.change is not None and profile.change.begins == 0:
        return max(profile.change.over_m - end.gap_m, 0.0)
    margin_m = settings.turning_room_m
    now = needed_deceleration(end, end.gap_m, context.speed_mps, margin_m)
    return max(_need_later(profile, end, margin_m) - max(now, settings.lane_end_need_mps2), 0.0)


def speed_limit(profile: values.Profile, context: values.RuleContext) -> float:
    """Excess of the final speed over the speed limit. [m/s]"""
    return max(profile.speeds[-1] - context.speed_limit_mps, 0.0)


def comfort(profile: values.Profile, context: values.RuleContext) -> float:
    """Excess of the acceleration or deceleration over the comfortable one. [m/s²]"""
    return max(abs(profile.target_mps2) - context.settings.comfort_mps2, 0.0)


def progress(profile: values.Profile, context: values.RuleContext) -> float:
    """Return the distance that a candidate loses, up to a constant. [m]

    In a lane that ends, the time until a lane change begins counts as lost. The loss grows in this
    order: a change in time, a change that ends too late, a change without a fitting gap, no change.
    """
    end, change = context.traffic.lane_end, profile.change
    if end is None:
        return -profile.ways[-1]
    if change is None:
        return 3.0 * DEAD_END_M - profile.ways[-1]
    if change.begins is None:
        return 2.0 * DEAD_END_M + change.short_ahead_m + change.short_behind_m
    waiting_m = change.begins * KNOT_S * context.speed_limit_mps
    too_late_m = DEAD_END_M if change.over_m > end.gap_m else 0.0
    return too_late_m + waiting_m - profile.ways[-1]


def _need_later(profile: values.Profile, other: values.Neighbour, margin_m: float) -> float:
    """Required deceleration after the second knot, if `other` keeps its speed. [m/s²]"""
    gap_m = other.gap_m + 2.0 * KNOT_S * other.speed_mps - profile.ways[1]
    return needed_deceleration(other, gap_m, profile.speeds[1], margin_m)


HIERARCHY = (
    # Tolerances keep rounding and noise in the estimates from deciding in the place of lower rules.
    Rule("no_collision", collision, 0.1),
    Rule("right_of_way", right_of_way, 0.02),
    Rule("clearance", clearance, 0.02),
    Rule("lane_end", lane_end, 0.02),
    Rule("speed_limit", speed_limit, 0.1),
    Rule("comfort", comfort, 0.05),
    Rule("progress", progress),
)


def choose(
    profiles: Sequence[values.Profile],
    context: values.RuleContext,
    hierarchy: Sequence[Rule] = HIERARCHY,
) -> values.RuleChoice:
    """Return the best candidate in lexicographic order; of equals the first in the list."""
    left, decided = list(profiles), UNOPPOSED
    for rule in hierarchy:
        if len(left) == 1:
            break
        costs = [rule.cost(profile, context) for profile in left]
        # Relative to the best, not to 0: if every candidate breaks a rule, the least breach goes
        # on.
        bar = min(costs) + rule.tolerance
        kept = [left[place] for place, cost in enumerate(costs) if cost <= bar]
        decided = rule.name if len(kept) < len(left) else decided
        left = kept
    return values.RuleChoice(left[0], decided)
