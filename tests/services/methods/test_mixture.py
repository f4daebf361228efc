"""The method `mixture`: what it prints, and what it refuses to print."""

import msgspec
import numpy as np
import pytest

from eigenfail.errors import InvalidValue, ProtocolError
from eigenfail.intervals import find_upper_bound
from eigenfail.values.disturbance import NoiseTrajectory
from eigenfail.values.episode import EpisodeResult, Outcome
from eigenfail.values.estimates import Estimate
from eigenfail.values.learning import LearnerContext
from eigenfail.values.measures import Measures
from eigenfail_services.methods import archive
from eigenfail_services.methods.mixture import (
    BLIND,
    MixtureMethod,
    MixtureSettings,
    judge_result,
)
from eigenfail_services.statistics.intervals import clopper_pearson
from eigenfail_services.statistics.mixture_sampling import MixtureResult
from eigenfail_services.statistics.pooled_estimate import estimate_from_draws
from eigenfail_services.statistics.subset_simulation import PlainCounts

NOTHING = np.zeros((0, 2, 2), np.float32)
EVEN = np.full(300, 0.01)
NO_ENDS = np.zeros(0)


def make_learner(episodes=600):
    return MixtureMethod(LearnerContext(7, episodes, 2, NOTHING), MixtureSettings())


def test_even_weights_are_an_estimate_with_an_interval():
    estimate = judge_result(MixtureResult(1000, 0, EVEN, NO_ENDS, NO_ENDS, 0.0), 2000, 10)
    assert estimate.probability == pytest.approx(0.003)
    assert estimate.bound is None
    assert estimate.effective == pytest.approx(300.0)
    assert estimate.interval.low < 0.003 < estimate.interval.high
    assert estimate.episodes == 2000
    assert estimate.note == BLIND


@pytest.mark.parametrize(
    ("result", "problem"),
    [
        (
            MixtureResult(1000, 0, np.zeros(0), NO_ENDS, NO_ENDS, 1.0),
            "None of the last draws failed",
        ),
        (
            MixtureResult(1000, 0, np.geomspace(1e-9, 1e-3, 100), NO_ENDS, NO_ENDS, 0.0),
            "failures carry the information of 14.",
        ),
        (
            MixtureResult(10_000, 0, np.arange(1.0, 2001.0) ** -0.9, NO_ENDS, NO_ENDS, 0.0),
            "The largest weights are too unequal",
        ),
        (
            MixtureResult(1000, 0, EVEN, NO_ENDS, NO_ENDS, 0.5),
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
    estimate = judge_result(MixtureResult(1000, 0, EVEN, NO_ENDS, NO_ENDS, 0.0), 2000, 400)
    assert "information of 300.0 independent ones, and 400 are needed" in estimate.problem


def test_last_draws_that_all_errored_are_named():
    nothing = judge_result(MixtureResult(1000, 1000, np.zeros(0), NO_ENDS, NO_ENDS, 1.0), 0, 10)
    assert nothing.problem == "All of the last draws errored: correct what raised."


def observe_all(learner, outcome_of, budget=600):
    """Run a learner to its end; return the number of episodes."""
    first = 0
    while sources := learner.propose(budget - first).sources:
        pairs = [(first + i, source) for i, source in enumerate(sources)]
        learner.observe([make_result(i, one, outcome_of(i, one.z)) for i, one in pairs])
        first += len(sources)
    return first


def test_a_search_without_failures_hands_its_budget_on_and_says_so():
    learner = make_learner()
    assert observe_all(learner, lambda *_: Outcome.SAFE) == 600
    found = learner.estimate()
    assert (found.probability, found.interval, found.episodes) == (None, None, 600)
    assert found.problem.startswith("Mixture sampling gave no number. Noise of one to four sigma")
    assert "met 0 failures in its first 160 episodes, and 9 are needed" in found.problem
    assert "None of the" in found.problem
    assert "P is at most" in found.problem


def test_failures_that_are_not_rare_are_counted_in_the_rest_of_the_budget():
    learner = make_learner()
    assert observe_all(learner, lambda _, z: get_outcome(z[0, 0] > 0.5)) == 600
    found = learner.estimate()
    assert (found.by, found.episodes) == ("Monte Carlo", 600)
    assert found.interval.low < 0.3085 < found.interval.high
    assert "Mixture sampling gave no number. Failures are not rare" in found.note


def test_a_rare_failure_that_the_search_misses_is_left_to_subset_simulation():
    """All four values of noise exceed 1.5: P = Q(1.5)⁴; of noise of four sigma 1.6 % fail."""
    learner, first = make_learner(1500), 0
    while sources := learner.propose(1500 - first).sources:
        results = []
        for i, source in enumerate(sources):
            gap = max(1.5 - float(source.z.min()), 0.0)
            one = make_result(first + i, source, get_outcome(gap == 0.0))
            results.append(msgspec.structs.replace(one, measures=Measures(gap)))
        learner.observe(results)
        first += len(sources)
    found = learner.estimate()
    assert found.by == "subset simulation"
    assert found.interval.low < 1.992e-5 < found.interval.high
    assert "Mixture sampling gave no number. Noise of one to four sigma" in found.note
    assert found.episodes == first


def test_errors_alone_end_the_search():
    learner = make_learner()
    assert observe_all(learner, lambda *_: Outcome.ERRORED) < 600
    assert learner.estimate().problem == "Every episode errored: correct what raised."


def test_errored_plain_draws_count_as_failures_in_the_bound():
    refused = Estimate(by="mixture sampling", episodes=100, problem="Nothing.")
    found = estimate_from_draws(refused, PlainCounts(draws=200, failures=0, errored=50))
    assert found.episodes == 250
    assert (
        f"P is at most {find_upper_bound(50, 200, 0.05):.1e} with 95 % confidence" in found.problem
    )
    assert "50 of these errored" in found.problem
    stated = estimate_from_draws(refused, PlainCounts(draws=200, failures=4, errored=50))
    assert stated.probability == 0.02
    assert stated.interval.high == clopper_pearson(54, 200).high
    assert stated.note.endswith("Mixture sampling gave no number. Nothing.")


def get_outcome(has_failed):
    return Outcome.COLLISION if has_failed else Outcome.SAFE


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
