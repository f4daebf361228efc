"""The method `mixture`: what it prints, and what it refuses to print."""

import numpy as np
import pytest

from eigenfail.errors import InvalidValue, ProtocolError
from eigenfail.values import (
    EpisodeResult,
    LearnerContext,
    Measures,
    NoiseTrajectory,
    Outcome,
)
from eigenfail_services.methods import archive
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
    estimate = judge_result(MixtureResult(1000, 0, EVEN, 0.0), 2000, 10)
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
        (MixtureResult(1000, 0, np.zeros(0), 1.0), "None of the last draws failed"),
        (
            MixtureResult(1000, 0, np.geomspace(1e-9, 1e-3, 100), 0.0),
            "failures carry the information of 14.",
        ),
        (
            MixtureResult(10_000, 0, np.arange(1.0, 2001.0) ** -0.9, 0.0),
            "The largest weights are too unequal",
        ),
        (
            MixtureResult(1000, 0, EVEN, 0.5),
            "50% of the failures that were kept from the fit lie where",
        ),
    ],
)
def test_a_number_that_is_not_to_be_trusted_is_not_printed(result, problem):
    estimate = judge_result(result, 2000, 10)
    assert problem in estimate.problem
    assert "Take method subset" in estimate.problem
    assert (estimate.probability, estimate.interval) == (None, None)


def test_fewer_failures_than_values_of_noise_are_too_few():
    estimate = judge_result(MixtureResult(1000, 0, EVEN, 0.0), 2000, 400)
    assert "information of 300.0 independent ones, and 400 are needed" in estimate.problem


def test_last_draws_that_all_errored_are_named():
    nothing = judge_result(MixtureResult(1000, 1000, np.zeros(0), 1.0), 0, 10)
    assert nothing.problem == "All of the last draws errored: correct what raised."


@pytest.mark.parametrize(
    ("outcome", "problem"),
    [
        (Outcome.SAFE, "Noise of one to four sigma met 0 failures, and 9 are needed: it ended"),
        (Outcome.COLLISION, "Failures are not rare: it ended after"),
        (Outcome.ERRORED, "Every episode errored"),
    ],
)
def test_a_search_that_ends_early_says_why(outcome, problem):
    learner = make_learner()
    while sources := learner.propose(600).sources:
        learner.observe([make_result(i, source, outcome) for i, source in enumerate(sources)])
    assert problem in learner.estimate().problem


def make_result(index, source, outcome):
    measures = None if outcome is Outcome.ERRORED else Measures(1.0)
    noise = NoiseTrajectory(source.z, np.ones_like(source.z))
    return EpisodeResult(
        index=index,
        seed=0,
        outcome=outcome,
        steps=len(source.z),
        noise=noise,
        source="trajectory",
        measures=measures,
    )


@pytest.mark.parametrize(("steps", "channels", "values"), [(501, 2, 1002), (201, 5, 1005)])
def test_noise_of_too_many_values_is_refused(steps, channels, values):
    nothing = np.zeros((0, steps, channels), np.float32)
    with pytest.raises(InvalidValue, match=f"{steps} steps have {values}"):
        MixtureMethod(LearnerContext(7, 600, steps, nothing), MixtureSettings())


def test_before_the_end_there_is_no_number():
    learner = make_learner()
    assert learner.estimate() is None
    learner.propose(600)
    assert learner.lookahead == 0


def test_a_state_of_more_than_was_requested_is_refused():
    facts = MixtureMethod._Facts(10_000)
    state = archive.write("mixture", facts, {"robustness_m": np.zeros(0)})
    with pytest.raises(ProtocolError, match="10000 trajectories of 20 were proposed"):
        make_learner().restore(state)


def test_a_budget_that_is_too_small_is_refused():
    with pytest.raises(InvalidValue, match="499 are too few"):
        make_learner(499)
