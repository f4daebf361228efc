"""The method `mixture`: what it prints, and what it refuses to print."""

import numpy as np
import pytest

from eigenfail.errors import InvalidValue
from eigenfail.values import LearnerContext
from eigenfail_services.methods.mixture import (
    BLIND,
    MixtureMethod,
    MixtureSettings,
    judge_result,
)
from eigenfail_services.statistics.mixture_sampling import MixtureResult

NOTHING = np.zeros((0, 2, 2), np.float32)
EVEN = np.full(300, 0.01)


def make_learner(episodes=600):
    return MixtureMethod(LearnerContext(7, episodes, 2, NOTHING), MixtureSettings())


def test_even_weights_are_an_estimate_with_an_interval():
    estimate = judge_result(MixtureResult(1000, EVEN, 0.0), 2000)
    assert estimate.probability == pytest.approx(0.003)
    assert estimate.bound is None
    assert estimate.effective == pytest.approx(300.0)
    assert estimate.interval is not None
    assert estimate.interval.low < 0.003 < estimate.interval.high
    assert estimate.episodes == 2000
    assert estimate.note == BLIND


@pytest.mark.parametrize(
    ("result", "problem"),
    [
        (MixtureResult(1000, np.zeros(0), 1.0), "None of the last draws failed"),
        (MixtureResult(1000, np.geomspace(1e-9, 1e-3, 100), 0.0), "are worth 14."),
        (
            MixtureResult(10_000, np.arange(1.0, 2001.0) ** -0.9, 0.0),
            "The largest weights are too unequal",
        ),
        (
            MixtureResult(1000, EVEN, 0.5),
            "50% of the failures that were kept from the fit lie where",
        ),
    ],
)
def test_a_number_that_is_not_to_be_trusted_is_not_printed(result, problem):
    estimate = judge_result(result, 2000)
    assert problem in estimate.problem
    assert "Take method subset" in estimate.problem
    assert (estimate.probability, estimate.interval) == (None, None)


def test_before_the_end_there_is_no_number():
    learner = make_learner()
    assert learner.estimate() is None
    learner.propose(600)
    assert learner.lookahead == 0


def test_a_budget_that_is_too_small_is_refused():
    with pytest.raises(InvalidValue, match="499 are too few"):
        make_learner(499)
