"""Changes of lane as candidates: when a gap fits, and when it will."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from eigenfail_workers.planners.rulebook import settings
from eigenfail_workers.planners.rulebook.candidates import KNOTS
from eigenfail_workers.planners.rulebook.changes import ChangePlanner
from eigenfail_workers.planners.rulebook.values import Gap, Neighbour, PlanStart, Task

SETTINGS = settings.ChangeSettings()
PLANNER = ChangePlanner(SETTINGS, settings.CandidateSettings(), settings.TruckLimits())
START = PlanStart(20.0, 0.0, Task(20.0, 0.5))
SPEEDS = st.floats(0.0, 40.0)


def at(gap_m, speed_mps=20.0):
    return Neighbour(gap_m, 3.5, speed_mps)


def test_what_is_owed_by_hand():
    owed = settings.RequiredGap(margin_m=5.0, headway_s=1.0, braking_mps2=1.5)
    assert owed.gap_m(20.0, 20.0) == 25.0
    assert owed.gap_m(20.0, 23.0) == 25.0
    assert owed.gap_m(23.0, 20.0) == pytest.approx(5.0 + 23.0 + 9.0 / 3.0)


@given(SPEEDS, SPEEDS, st.floats(0.0, 5.0))
def test_more_is_owed_the_faster_the_rear_one_and_the_slower_the_front_one(rear, front, more):
    owed = SETTINGS.behind
    assert owed.gap_m(rear + more, front) >= owed.gap_m(rear, front)
    assert owed.gap_m(rear, front + more) <= owed.gap_m(rear, front)


def test_a_gap_that_fits_is_entered_now():
    """Owed at 20 m/s: 25 m ahead, 12 m behind."""
    change = PLANNER.plan_change("any", Gap(at(29.0), at(12.5)), START).change
    assert (change.begins, change.over_m) == (0, 20.0 * SETTINGS.lateral.change_s)
    assert PLANNER.plan_change("any", Gap(), START).change.begins == 0


def test_a_gap_that_is_too_short_behind_fits_once_the_truck_has_drawn_ahead():
    faster = PlanStart(21.0, 0.0, Task(21.0, 0.5))
    profile = PLANNER.plan_change("any", Gap(None, at(9.6)), faster)
    assert profile.change.begins == 5  # 2.4 m at 1 m/s; knots are 0.5 s
    assert profile.change.over_m == pytest.approx(2.5 * 21.0 + 21.0 * SETTINGS.lateral.change_s)
    assert len(profile.ways) == len(profile.accelerations) == KNOTS


def test_a_gap_beside_somebody_is_made_for_by_dropping_back():
    profile = PLANNER.plan_change("any", Gap(at(-5.0), None), START)
    assert profile.target_mps2 < -1.0
    assert profile.target_mps2 >= -SETTINGS.braking_mps2
    assert profile.change.begins > KNOTS


def test_a_gap_that_is_shorter_than_what_is_owed_in_it_is_never_in_sight():
    change = PLANNER.plan_change("any", Gap(at(20.0), at(10.0)), START).change
    assert change.begins is None
    assert change.short_ahead_m + change.short_behind_m > 0.0


def test_once_begun_less_is_asked_for_and_what_is_missing_is_said():
    share = SETTINGS.begun_share
    enough = PLANNER.continue_change("any", Gap(None, at(12.0 * share + 0.1)), START, 50.0).change
    assert (enough.begins, enough.short_behind_m, enough.hit_mps) == (0, 0.0, 0.0)
    short = PLANNER.continue_change("any", Gap(None, at(12.0 * share - 2.0)), START, 50.0).change
    assert short.short_behind_m == pytest.approx(2.0)
    assert short.over_m == 50.0


def test_who_would_run_into_the_truck_within_the_horizon_is_a_collision():
    """4 m/s faster over a horizon of 5 s: 20 m."""
    assert (
        PLANNER.continue_change("any", Gap(None, at(19.0, 24.0)), START, 50.0).change.hit_mps == 4.0
    )
    assert (
        PLANNER.continue_change("any", Gap(None, at(21.0, 24.0)), START, 50.0).change.hit_mps == 0.0
    )
