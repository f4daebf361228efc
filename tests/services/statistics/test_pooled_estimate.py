"""Pooling: a mean, its deviation, and no number where one is missing."""

from math import sqrt

import numpy as np
import pytest

from eigenfail.values.estimates import Estimate
from eigenfail_services.statistics.intervals import log_normal
from eigenfail_services.statistics.pooled_estimate import pool_estimates


def estimate(probability=None, cv=None, episodes=100, by="subset simulation", **more):
    return Estimate(by=by, episodes=episodes, probability=probability, cv=cv, **more)


def test_two_by_hand():
    """0.25 · 0.038 + 0.75 · 0.04 = 0.0395; deviations 0.25 · 0.0076 and 0.75 · 0.004."""
    found = pool_estimates([estimate(0.038, 0.2, 100, effective=30.0), estimate(0.04, 0.1, 300)])
    assert found.probability == pytest.approx(0.0395)
    assert found.cv == pytest.approx(0.1 * sqrt(0.019**2 + 0.03**2) / 0.0395)
    assert (found.episodes, found.by, found.effective) == (400, "subset simulation", None)


def test_many_that_are_alike_are_as_good_as_the_square_root_of_their_number():
    found = pool_estimates([estimate(1e-4, 0.4, effective=20.0)] * 16)
    assert found.probability == pytest.approx(1e-4)
    assert found.cv == pytest.approx(0.1)
    assert found.effective == 320.0
    assert found.interval == log_normal(found.probability, found.cv, 320.0)


def test_the_mean_of_lower_bounds_is_a_lower_bound_however_well_they_agree():
    bounds = [estimate(1e-4, 0.04, by="importance sampling", bound="lower")] * 3
    found = pool_estimates([*bounds, estimate(1e-4, 0.04)])  # one is enough
    assert found.probability == pytest.approx(1e-4)
    assert (found.bound, found.interval) == ("lower", None)


def test_its_interval_holds_the_truth_as_often_as_it_says():
    random, truth, cv = np.random.default_rng(0), 1e-3, 0.3
    spread = sqrt(np.log1p(cv**2))
    draws = truth * np.exp(random.normal(-(spread**2) / 2, spread, (2000, 4)))
    found = [pool_estimates([estimate(float(p), cv) for p in row]).interval for row in draws]
    told = [interval for interval in found if interval is not None]
    assert len(told) >= 0.99 * len(found), "one in a thousand pairs lies apart by chance"
    held = np.mean([interval.low <= truth <= interval.high for interval in told])
    assert 0.93 <= held <= 0.98


def test_members_that_know_different_failures_make_no_number():
    found = pool_estimates([estimate(1e-4, 0.1), estimate(1e-6, 0.1)])
    assert found.probability is found.interval is None
    assert "1.0e-04, 1.0e-06" in found.problem


def test_members_that_lie_apart_make_the_whole_less_sure():
    near, far = (pool_estimates([estimate(1e-4, 0.3), estimate(p, 0.3)]) for p in (1e-4, 2.5e-4))
    assert far.cv > 1.3 * near.cv


def test_one_that_refuses_a_number_refuses_it_for_all():
    found = pool_estimates([estimate(0.1, 0.1), estimate(problem="Too few. Run more.")])
    assert found.probability is found.interval is None
    assert found.problem == "Member 1: Too few. Run more."
    assert found.episodes == 200


@pytest.mark.parametrize("others", [estimate(0.1), estimate(0.0, 0.1)])
def test_without_a_variation_there_is_no_interval(others):
    found = pool_estimates([others, estimate(0.0, None)])
    assert (found.cv, found.interval) == (None, None)


def test_no_interval_goes_beyond_certainty():
    assert log_normal(0.9, 1.0).high == 1.0
