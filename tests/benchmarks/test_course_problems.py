"""Walks of known probability, and which methods are judged by how often their intervals hold."""

from math import sqrt

import numpy as np
import pytest
from benchmarks.truth.course_problems import COURSE_PROBLEMS, find_exit
from benchmarks.truth.intervals import FEWEST_JUDGED, LEAST_HELD, PLANS, judge

from eigenfail import plugins


def test_probabilities_of_walks_are_those_of_plain_draws():
    random = np.random.default_rng(11)
    for problem in COURSE_PROBLEMS:
        z = random.standard_normal((40_000, problem.steps, 1))
        share = float(problem.walk(z)[1].any(axis=1).mean())
        truth = problem.probability
        assert abs(share - truth) < 4.0 * sqrt(truth / 40_000) + 1e-4


def test_a_walk_of_one_step_has_a_normal_probability():
    assert find_exit(1.0, -2.0, 2.0, 1) == pytest.approx(0.0455003, rel=1e-5)


def test_every_method_that_prints_an_interval_is_judged():
    judged = {plan.method for plan in PLANS}
    methods = [plugins.load(plugins.METHODS, name) for name in plugins.names(plugins.METHODS)]
    assert {one for one in methods if one.traits.bounds_probability} <= judged
    assert (LEAST_HELD, FEWEST_JUDGED) == (0.93, 20)


def test_a_campaign_without_a_number_counts_as_an_estimate_of_0():
    from eigenfail.values.estimates import Estimate
    from eigenfail_services.statistics.intervals import log_normal

    told = Estimate(by="", episodes=1, probability=0.1, cv=0.1, interval=log_normal(0.1, 0.1))
    verdict = judge([told, Estimate(by="", episodes=1, problem="no")], 0.1)
    assert (verdict.told, verdict.held) == (0.5, 1.0)
    assert verdict.error == pytest.approx(sqrt(0.5))
