"""Out of the lane that ends, phase by phase: commitment, point of no return, abort."""

import pytest
from msgspec import structs

from eigenfail.values.scene import VehicleState
from eigenfail_workers.planners.rulebook import settings, values
from eigenfail_workers.planners.rulebook.lanes import ABORT, COMMITMENT, make_lane_planner
from eigenfail_workers.planners.rulebook.rules import choose
from eigenfail_workers.planners.rulebook.tracker import AxisFilter, Track, TrackState

SETTINGS = settings.MergeSettings()
TASK = values.Task(22.0, 0.5)
EGO = VehicleState(0.0, 0.0, 0.0, 20.0, 16.0, 2.5)


def track(gap_m, speed_mps=20.0, ego=EGO):
    """A car on the main lane that far ahead of the truck (+) or behind it (-)."""
    x_m = ego.x_m + gap_m + (10.5 if gap_m > 0 else -10.5)
    seen = VehicleState(x_m, 3.5, 0.0, speed_mps, 5.0, 2.0)
    found = Track(AxisFilter(x_m, speed_mps, 1.0, 1.0), AxisFilter(3.5, 0.0, 0.2, 0.2), seen)
    found.age, found.state = 50, TrackState.CONFIRMED
    return found


@pytest.fixture
def ramp(mission):
    return structs.replace(mission, lane_0_ends_x_m=400.0)


@pytest.fixture
def approaching(ramp):
    return make_lane_planner(SETTINGS, ramp, settings.CandidateSettings(), settings.TruckLimits())


def decide(lane, *tracks, ego=EGO):
    """One step: the choice, and the phase from then on."""
    traffic = lane.observe(tracks, ego, values.Traffic())
    offered = lane.propose(values.PlanStart(ego.speed_mps, 0.0, TASK), traffic)
    context = values.RuleContext(traffic, ego.speed_mps, 25.0, settings.RuleSettings())
    return lane.decide(choose(offered, context), offered, ego)


def begun(lane, *tracks, ego=EGO):
    """A change that has just begun."""
    for _ in range(SETTINGS.commit):
        _, lane = decide(lane, *tracks, ego=ego)
    assert lane.phase is values.LanePhase.CHANGING
    return lane


def test_where_the_lane_goes_on_the_truck_is_held_to_it(mission):
    lane = make_lane_planner(
        SETTINGS, mission, settings.CandidateSettings(), settings.TruckLimits()
    )
    choice, after = decide(lane, track(100.0), track(-100.0))
    assert (after, lane.phase) == (lane, values.LanePhase.IN_LANE)
    assert choice.profile.change is None


def test_on_the_next_lane_the_end_of_lane_0_is_nobody_s_concern(approaching):
    choice, lane = decide(approaching, ego=structs.replace(EGO, y_m=3.5))
    assert lane.phase is values.LanePhase.IN_LANE
    assert choice.profile.change is None


def test_a_free_lane_is_entered_after_some_steps_in_a_row(approaching):
    lane = approaching
    for _ in range(SETTINGS.commit - 1):
        choice, lane = decide(lane)
        assert (choice.profile.name, lane.phase) == ("change_lane", values.LanePhase.APPROACHING)
    choice, lane = decide(lane)
    assert lane.phase is values.LanePhase.CHANGING


def test_a_step_in_which_the_gap_does_not_fit_starts_the_count_anew(approaching):
    lane = approaching
    for _ in range(3):
        for _ in range(SETTINGS.commit - 1):
            _, lane = decide(lane, track(-13.0))
        _, lane = decide(lane, track(-11.0))
    assert lane.phase is values.LanePhase.APPROACHING


@pytest.mark.parametrize(
    ("tracks", "candidate"),
    [
        ((-13.0, 60.0), "merge_early"),
        ((-6.0, 60.0), "merge_early"),
        ((-2.0, 15.0), "merge_late"),
        ((-90.0, 60.0), "change_lane"),
    ],
)
def test_the_gap_that_can_be_entered_first_is_made_for(approaching, tracks, candidate):
    choice, _ = decide(approaching, *(track(gap_m) for gap_m in tracks))
    assert (choice.profile.name, choice.rule) == (candidate, "progress")


def test_somebody_fast_from_behind_is_let_past(approaching):
    choice, _ = decide(approaching, track(-25.0, speed_mps=25.0), track(60.0))
    assert choice.profile.name == "merge_late"


def test_a_choice_is_kept_until_another_is_ahead_for_some_steps(approaching):
    lane = approaching
    choice, lane = decide(lane, track(-6.0, 19.0))
    assert choice.profile.name == "merge_early"
    for _ in range(SETTINGS.commit - 1):
        choice, lane = decide(lane, track(-6.0, 25.0))
        assert (choice.profile.name, choice.rule) == ("merge_early", COMMITMENT)
    choice, lane = decide(lane, track(-6.0, 25.0))
    assert choice.profile.name == "merge_late"


def test_before_the_lane_ends_it_stops_and_that_is_never_put_off(approaching):
    """At 20 m/s and 2.2 m/s² it takes 91 m, and 60 m are for turning."""
    ego = structs.replace(EGO, x_m=400.0 - 8.0 - 60.0 - 85.0)
    beside = track(2.0, ego=ego), track(-10.0, ego=ego)
    far = structs.replace(EGO, x_m=100.0)
    choice, _ = decide(approaching, track(2.0, ego=far), track(-10.0, ego=far), ego=far)
    assert choice.profile.name != "stop"
    choice, _ = decide(approaching, *beside, ego=ego)
    assert (choice.profile.name, choice.rule) == ("stop", "lane_end")
    assert choice.profile.target_mps2 == pytest.approx(-400.0 / (2 * 85.0))


def test_a_change_that_would_be_over_too_late_is_not_begun(approaching):
    """100 m at 20 m/s; 95 m are left."""
    ego = structs.replace(EGO, x_m=400.0 - 8.0 - 95.0)
    choice, _ = decide(approaching, ego=ego)
    assert choice.rule == "lane_end"
    assert choice.profile.name == "stop"


def test_a_follower_who_comes_too_near_makes_it_turn_back_before_the_line(approaching):
    lane = begun(approaching, track(-13.0))
    inside = structs.replace(EGO, x_m=10.0, y_m=0.3)
    choice, _ = decide(lane, track(-8.0, ego=inside), ego=inside)
    assert choice.profile.name == "merge_early"
    choice, back = decide(lane, track(-4.0, ego=inside), ego=inside)
    assert (choice.profile.name, choice.rule) == (ABORT, "right_of_way")
    assert back.phase is values.LanePhase.APPROACHING
    assert back.steer(inside) < 0.0 or back.steer(structs.replace(inside, x_m=60.0)) < 0.0


def test_a_collision_in_sight_outranks_all_else(approaching):
    lane = begun(approaching, track(-13.0))
    choice, _ = decide(lane, track(-13.0, speed_mps=24.0))
    assert (choice.profile.name, choice.rule) == (ABORT, "no_collision")


def test_across_the_line_there_is_no_way_back(approaching):
    lane = begun(approaching, track(-13.0))
    across = structs.replace(EGO, x_m=30.0, y_m=0.6)
    choice, after = decide(lane, track(-4.0, ego=across), ego=across)
    assert (choice.profile.name, choice.rule) == ("merge_early", "unopposed")
    assert after.phase is values.LanePhase.CHANGING


def test_nor_is_there_one_too_near_to_the_end_of_the_lane(approaching):
    late = structs.replace(EGO, x_m=400.0 - 8.0 - 102.0)
    lane = begun(approaching, track(-13.0, ego=late), ego=late)
    choice, after = decide(lane, track(-4.0, ego=late), ego=late)
    assert after.phase is values.LanePhase.CHANGING
    assert choice.profile.name == "merge_early"


def test_who_is_ahead_in_the_gap_is_the_lead_while_the_truck_comes_over(approaching):
    lane = begun(approaching, track(40.0))
    assert lane.observe([track(40.0)], EGO, values.Traffic()).lead.gap_m == 40.0


def test_at_the_end_of_its_path_it_is_held_to_the_new_lane(approaching):
    lane = begun(approaching)
    there = structs.replace(EGO, x_m=101.0, y_m=3.4)
    _, lane = decide(lane, ego=there)
    assert lane.phase is values.LanePhase.IN_LANE
    assert lane.steer(there) > 0.0
    assert lane.steer(structs.replace(there, y_m=3.6)) < 0.0


def test_the_verdict_of_a_rule_above_progress_is_taken_at_once(approaching):
    decide(approaching, track(-6.0, 19.0))
    traffic = approaching.observe([track(-6.0, 19.0)], EGO, values.Traffic())
    offered = approaching.propose(values.PlanStart(20.0, 0.0, TASK), traffic)
    stop = next(profile for profile in offered if profile.name == "stop")
    choice, _ = approaching.decide(values.RuleChoice(stop, "lane_end"), offered, EGO)
    assert choice.profile.name == "stop"
