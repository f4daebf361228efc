"""The refining program: follows, smooths, keeps its distance, and does not disturb what is good."""

import pytest

from eigenfail_workers.planners.rulebook.candidates import Start, roll_out
from eigenfail_workers.planners.rulebook.driving_modes import Task
from eigenfail_workers.planners.rulebook.quadratic_program import QpStatus
from eigenfail_workers.planners.rulebook.refine import Refiner, RefineSettings
from eigenfail_workers.planners.rulebook.surroundings import Neighbour
from eigenfail_workers.planners.rulebook.truck import TruckLimits

LIMITS = TruckLimits()
TASK = Task(24.0, 0.5)


def refine(target, lead=None, acceleration=0.0, refiner=None):
    start = Start(20.0, acceleration, TASK)
    profile = roll_out("any", start, target, LIMITS)
    return (refiner or Refiner(RefineSettings(), LIMITS))(profile, start, lead)


def test_a_steady_candidate_stays_as_it_is():
    status, first = refine(-1.0, acceleration=-1.0)
    assert status is QpStatus.SOLVED
    assert first == pytest.approx(-1.0, abs=0.02)


def test_a_jump_is_smoothed():
    _, first = refine(-2.0)
    assert -2.0 < first < -1.0


def test_it_brakes_for_a_lead_that_the_candidate_forgot():
    assert refine(0.0, Neighbour(60.0, 0.0, 20.0))[1] == pytest.approx(0.0, abs=0.02)
    assert refine(0.0, Neighbour(20.0, 0.0, 10.0))[1] < -0.5


def test_a_hopeless_gap_is_paid_for_with_slack_not_with_infeasibility():
    status, first = refine(-4.0, Neighbour(1.0, 0.0, 0.0), acceleration=-7.0)
    assert status is QpStatus.SOLVED
    assert -7.1 <= first <= -3.0


def test_after_a_reset_nothing_is_remembered():
    refiner = Refiner(RefineSettings(), LIMITS)
    fresh = refine(-1.0, refiner=refiner)
    for lead in (Neighbour(10.0, 0.0, 5.0), None):
        refine(-3.0, lead, refiner=refiner)
    refiner.reset()
    assert refine(-1.0, refiner=refiner) == fresh
