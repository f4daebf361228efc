"""The hierarchy: strictly lexicographic, and it knows which rule decided."""

import pytest
from msgspec import structs

from eigenfail_workers.planners.rulebook import settings, values
from eigenfail_workers.planners.rulebook.candidates import KNOTS, roll_out, roll_out_all
from eigenfail_workers.planners.rulebook.rules import (
    HIERARCHY,
    UNOPPOSED,
    Rule,
    choose,
    clearance,
    collision,
    lane_end,
    progress,
    right_of_way,
)
from eigenfail_workers.planners.rulebook.traffic import required_deceleration

LIMITS = settings.TruckLimits()
TASK = values.Task(24.0, 0.5)


def candidates(traffic, speed_mps=24.0):
    start = values.PlanStart(speed_mps, 0.0, TASK)
    return roll_out_all(start, traffic, settings.CandidateSettings(), LIMITS)


def choice(traffic, speed_mps=24.0):
    context = values.RuleContext(traffic, speed_mps, 25.0, settings.RuleSettings())
    return choose(candidates(traffic, speed_mps), context)


def table(costs, tolerances=(0.0, 0.0, 0.0)):
    """Choose among made-up profiles whose costs by rule are given."""
    made = [values.Profile(name, 0.0, [], [], []) for name in costs]
    rules = [
        Rule(f"rule {k}", lambda profile, _context, k=k: costs[profile.name][k], tolerance)
        for k, tolerance in enumerate(tolerances)
    ]
    found = choose(
        made, values.RuleContext(values.Traffic(), 24.0, 25.0, settings.RuleSettings()), rules
    )
    return found.profile.name, found.rule


def test_a_higher_rule_outweighs_any_amount_below():
    assert table({"a": (0, 1e9, 1e9), "b": (1, 0, 0)}) == ("a", "rule 0")
    assert table({"a": (1, 1, 1e9), "b": (1, 2, 0)}) == ("a", "rule 1")


def test_the_deciding_rule_is_the_one_that_turned_the_last_rival_down():
    assert table({"a": (0, 1, 0), "b": (0, 0, 3), "c": (5, 0, 0)}) == ("b", "rule 1")
    assert table({"a": (0, 0, 0), "b": (0, 0, 0), "c": (5, 0, 0)}) == ("a", "rule 0")


def test_differences_within_the_tolerance_go_on_to_the_next_rule():
    costs = {"a": (0.0, 5, 0), "b": (0.4, 1, 0)}
    assert table(costs, (0.5, 0, 0)) == ("b", "rule 1")
    assert table(costs, (0.3, 0, 0)) == ("a", "rule 0")


def test_alone_or_equal_is_unopposed():
    assert table({"a": (3, 2, 1)}) == ("a", UNOPPOSED)
    assert table({"a": (0, 0, 0), "b": (0, 0, 0)}) == ("a", UNOPPOSED)


def test_the_order_of_the_paper_s_hierarchy():
    assert [rule.name for rule in HIERARCHY] == [
        "no_collision",
        "right_of_way",
        "clearance",
        "lane_end",
        "speed_limit",
        "comfort",
        "progress",
    ]


RAMP = values.Traffic(lane_end=values.Neighbour(300.0, 0.0, 0.0))


def cost(rule, change, traffic=RAMP):
    """Of a candidate at 20 m/s that keeps its speed."""
    profile = roll_out("any", values.PlanStart(20.0, 0.0, values.Task(20.0, 0.5)), 0.0, LIMITS)
    context = values.RuleContext(traffic, 20.0, 25.0, settings.RuleSettings())
    return rule(structs.replace(profile, change=change), context)


def test_what_a_change_of_lane_costs_by_each_rule():
    now = values.LaneChange(begins=0, over_m=100.0)
    assert [cost(rule.cost, now) for rule in HIERARCHY[:-1]] == [0.0] * 6
    for name, value, rule in (
        ("hit_mps", 4.0, collision),
        ("short_behind_m", 2.0, right_of_way),
        ("short_ahead_m", 3.0, clearance),
    ):
        assert cost(rule, structs.replace(now, **{name: value})) == value
    assert cost(lane_end, structs.replace(now, over_m=305.0)) == 5.0


def test_what_a_change_still_lacks_is_no_cost_before_it_begins():
    waiting = values.LaneChange(begins=None, short_ahead_m=9.0, short_behind_m=9.0)
    assert cost(right_of_way, waiting) == cost(clearance, waiting) == 0.0


def test_the_end_of_the_lane_asks_for_braking_from_a_need_on():
    """With 60 m to turn: 1 s later 2.0 m/s² at 180 m, and 400 / (2 · 75) m/s² at 155 m."""
    far, near = (
        values.Traffic(lane_end=values.Neighbour(gap_m, 0.0, 0.0)) for gap_m in (180.0, 155.0)
    )
    assert cost(lane_end, None, far) == 0.0
    now = 400.0 / (2.0 * 95.0)
    assert cost(lane_end, None, near) == pytest.approx(400.0 / (2.0 * 75.0) - max(now, 2.2))
    assert cost(lane_end, None, values.Traffic()) == 0.0


def test_in_a_lane_that_ends_progress_is_to_leave_it_soon():
    options = [
        values.LaneChange(begins=0, over_m=100.0),
        values.LaneChange(begins=4, over_m=150.0),
        values.LaneChange(begins=30, over_m=290.0),
        values.LaneChange(begins=4, over_m=310.0),
        values.LaneChange(short_behind_m=2.0),
        values.LaneChange(short_behind_m=3.0),
        None,
    ]
    costs = [cost(progress, change) for change in options]
    assert costs == sorted(costs)
    assert len(set(costs)) == len(costs)
    assert cost(progress, None, values.Traffic()) == -100.0


def test_an_empty_road_is_for_progress():
    assert choice(values.Traffic(), 20.0).profile.name == "keep"
    assert choice(values.Traffic(), 20.0).rule == "progress"


def test_a_lead_that_would_be_hit_is_followed_because_of_that():
    traffic = values.Traffic(lead=values.Neighbour(25.0, 0.5, 12.0))
    assert (choice(traffic, 20.0).profile.name, choice(traffic, 20.0).rule) == (
        "follow",
        "no_collision",
    )


def test_a_slower_neighbour_is_given_room_once_it_needs_it():
    far = values.Traffic(neighbour=values.Neighbour(120.0, 3.5, 12.0))
    near = values.Traffic(neighbour=values.Neighbour(60.0, 3.5, 12.0))
    assert choice(far).profile.name == "keep"
    assert (choice(near).profile.name, choice(near).rule) == ("slow", "clearance")


def test_candidates_are_offered_only_where_they_make_sense():
    names = {profile.name for profile in candidates(values.Traffic())}
    assert names == {"keep", "hold"}
    lead = values.Neighbour(30.0, 0.0, 12.0)
    assert {p.name for p in candidates(values.Traffic(lead, lead))} == names | {"follow", "slow"}
    assert {p.name for p in candidates(RAMP)} == names | {"stop"}


def test_profiles_respect_jerk_task_and_standstill():
    limits = LIMITS
    up = roll_out("up", values.PlanStart(23.9, 0.0, TASK), 0.5, limits)
    assert max(up.speeds) <= 24.0
    down = roll_out("down", values.PlanStart(3.0, 0.0, TASK), -4.0, limits)
    assert down.speeds[-1] == 0.0
    assert down.ways[-1] == down.ways[-2]
    assert down.accelerations[0] == pytest.approx(-limits.comfort_jerk_mps3 * 0.5)
    assert len(down.ways) == KNOTS


@pytest.mark.parametrize(
    ("gap_m", "closing_mps", "expected"),
    [(55.0, 10.0, 1.0), (55.0, -10.0, 0.0), (5.0, 1.0, 100.0), (4.0, 0.0, 0.0)],
)
def test_required_deceleration_by_hand(gap_m, closing_mps, expected):
    assert required_deceleration(gap_m, closing_mps, 5.0) == expected
