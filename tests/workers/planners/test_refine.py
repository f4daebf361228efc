"""The refining program: follows, smooths, keeps its distance, and does not disturb what is good."""

import numpy as np
import pytest

from eigenfail_workers.planners.rulebook.candidates import KNOTS, roll_out
from eigenfail_workers.planners.rulebook.refine import Refiner, candidate_shares, first_shares
from eigenfail_workers.planners.rulebook.settings import RefineSettings, SolverSettings, TruckLimits
from eigenfail_workers.planners.rulebook.values import Neighbour, PlanStart, QpStatus, Task

LIMITS = TruckLimits()
TASK = Task(24.0, 0.5)


def refine(target, lead=None, acceleration=0.0, refiner=None):
    start = PlanStart(20.0, acceleration, TASK)
    profile = roll_out("any", start, target, LIMITS)
    return (refiner or Refiner(RefineSettings(), LIMITS))(profile, start, lead)


def test_a_steady_candidate_stays_as_it_is():
    status, first = refine(-1.0, acceleration=-1.0)
    assert status is QpStatus.SOLVED
    assert first == pytest.approx(-1.0, abs=0.02)


def test_it_brakes_for_a_lead_that_the_candidate_forgot():
    assert refine(0.0, Neighbour(60.0, 0.0, 20.0))[1] == pytest.approx(0.0, abs=0.02)
    assert refine(0.0, Neighbour(20.0, 0.0, 10.0))[1] < -0.5


def test_a_hopeless_gap_is_paid_for_with_slack_not_with_infeasibility():
    status, first = refine(-4.0, Neighbour(1.0, 0.0, 0.0), acceleration=-7.0)
    assert status is QpStatus.SOLVED
    assert -7.1 <= first <= -3.0


EXACT = SolverSettings(tolerance=1e-8, max_iterations=50_000)


def plan(target, lead=None, acceleration=0.0, **settings):
    """All variables of the program, solved exactly: accelerations and slack."""
    refiner = Refiner(RefineSettings(solver=EXACT, **settings), LIMITS)
    refine(target, lead, acceleration, refiner)
    return refiner._program.solve().x


@pytest.mark.parametrize("knots", [10, 20, 25, 40])
def test_without_limits_the_plan_has_a_closed_form(knots):
    """h (a - r) + w/h Dᵀ(D a - d) = 0: the gradient of the two sums of squares."""
    h, weight, before = 5.0 / knots, 0.075, -0.8
    reference = roll_out("any", PlanStart(20.0, before, TASK), -1.0, LIMITS).accelerations
    change, first = np.eye(knots) - np.eye(knots, k=-1), np.eye(knots)[0]
    r = candidate_shares(RefineSettings(knots=knots)) @ reference
    system = h * np.eye(knots) + weight / h * change.T @ change
    expected = np.linalg.solve(system, h * r + weight / h * before * first)
    found = plan(-1.0, acceleration=before, knots=knots)
    assert found[:-1] == pytest.approx(expected, abs=1e-4)


@pytest.mark.parametrize("knots", [10, 20, 50])
def test_no_knot_exceeds_the_jerk_and_none_comes_too_near(knots):
    h, lead, before = 5.0 / knots, Neighbour(25.0, 0.0, 12.0), 0.4
    *a, slack = plan(-3.0, lead, before, knots=knots)
    assert np.abs(np.diff([before, *a])).max() <= LIMITS.comfort_jerk_mps3 * h + 1e-4
    speeds = 20.0 + h * np.cumsum([0.0, *a])
    ways = h * np.cumsum((speeds[:-1] + speeds[1:]) / 2.0)
    room = lead.gap_m - 4.0 + lead.speed_mps * h * np.arange(1, knots + 1)
    assert np.all(ways <= room + slack + 1e-3)
    assert slack >= -1e-6


@pytest.mark.parametrize("lead", [None, Neighbour(12.0, 0.0, 13.0)])
def test_more_knots_are_the_same_program_finer(lead):
    """The error is of first order in the length of a knot: it halves with it."""
    means = [
        first_shares(RefineSettings(knots=knots)) @ plan(-1.5, lead, knots=knots)
        for knots in (20, 40, 80)
    ]
    coarse, fine = np.abs(np.diff(means))
    assert fine < 0.6 * coarse


def test_the_candidate_is_divided_among_the_knots():
    assert candidate_shares(RefineSettings(knots=20)) == pytest.approx(
        np.repeat(np.eye(KNOTS), 2, axis=0)
    )
    straddling = candidate_shares(RefineSettings(knots=25))[2]
    assert straddling[:3] == pytest.approx([0.5, 0.5, 0.0])
    beyond = candidate_shares(RefineSettings(horizon_s=8.0, knots=16))
    assert beyond[10:] == pytest.approx(np.repeat(np.eye(KNOTS)[-1:], 6, axis=0))
    assert beyond.sum(axis=1) == pytest.approx(np.ones(16))


@pytest.mark.parametrize(("knots", "weights"), [(20, [0.5, 0.5]), (25, [0.4, 0.4, 0.2]), (5, [1])])
def test_the_answer_is_the_mean_over_the_candidates_first_knot(knots, weights):
    shares = first_shares(RefineSettings(knots=knots))
    assert shares == pytest.approx([*weights, *[0.0] * (knots + 1 - len(weights))])


def test_the_same_questions_get_the_same_bits():
    targets = [(-2.0, None), (0.3, Neighbour(40.0, 0.0, 15.0)), (-1.0, None), (0.0, None)]
    runs = []
    for _ in range(2):
        refiner = Refiner(RefineSettings(), LIMITS)
        runs.append([refine(target, lead, refiner=refiner) for target, lead in targets])
        refiner.reset()
        runs.append([refine(target, lead, refiner=refiner) for target, lead in targets])
    assert all(run == runs[0] for run in runs)
