"""Linear-Gaussian half spaces: P is known, and so is the likeliest failure."""

import numpy as np
import pytest
from odd_problems import run_search
from problems import SMALL_AST, HalfSpace, cosine, steady, turning

from eigenfail.values.learning import STATE

PROBABILITIES = (1e-3, 1e-6)
HELD_AST = {**SMALL_AST, "hold": 2}
LIKELIHOOD_COUNTS = {
    "hold": 1,
    "batch_size": 64,
    "alpha": 30.0,
    "c_dist": 30.0,
    "entropy": 3.0,
    "target_entropy": -2.0,
    "learning_rate": 3e-3,
    "amplitude": 6.0,
}
"""Penalties of the size of log p; noise is drawn from far beyond the likeliest failure."""


def failures(results):
    return [result for result in results if result.is_failure]


def failure_rate(results):
    return len(failures(results)) / len(results)


def test_monte_carlo_knows_the_probability():
    problem = HalfSpace(0.2, turning(20))
    _, results = run_search(problem, "monte_carlo", 1000)
    assert failure_rate(results) == pytest.approx(0.2, abs=4 * (0.2 * 0.8 / 1000) ** 0.5)


@pytest.mark.parametrize("direction", [steady, turning])
@pytest.mark.parametrize("probability", PROBABILITIES)
def test_cem_fails_in_a_third_of_its_episodes_where_monte_carlo_never_would(probability, direction):
    """A factor of 300 over Monte Carlo at 1e-3, of 300,000 at 1e-6."""
    problem = HalfSpace(probability, direction(20))
    learner, results = run_search(problem, "cem", 400)
    assert failure_rate(results) >= 0.3
    assert cosine(learner.proposal.mean, problem.direction) >= 0.65


@pytest.mark.parametrize("direction", [steady, turning])
@pytest.mark.parametrize("probability", PROBABILITIES)
def test_cma_fails_in_half_of_its_episodes_and_comes_near_the_likeliest_failure(
    probability, direction
):
    problem = HalfSpace(probability, direction(20))
    _, results = run_search(problem, "cma", 1000, hold=5)
    assert failure_rate(results) >= 0.5
    noise = [result.noise.z for result in failures(results)]
    likeliest = min(noise, key=np.linalg.norm)
    assert np.linalg.norm(likeliest) <= 1.25 * problem.beta
    assert cosine(likeliest, problem.direction) >= 0.85


@pytest.mark.parametrize("probability", PROBABILITIES[1:])
def test_with_larger_rounds_cem_points_along_the_likeliest_failure(probability):
    problem = HalfSpace(probability, turning(20))
    learner, _ = run_search(problem, "cem", 1000, batch=100, mean_window=1)
    assert cosine(learner.proposal.mean, problem.direction) >= 0.88


@pytest.mark.parametrize("probability", [1e-4, 1e-6])
def test_ast_fails_most_of_the_time_once_it_has_trained(probability):
    problem = HalfSpace(probability, turning(8))
    _, results = run_search(problem, "ast", 160, **HELD_AST)
    untrained, trained = failure_rate(results[:30]), failure_rate(results[-40:])
    assert trained >= 0.8  # 8,000 and 800,000 times the prior's
    assert trained >= 4 * untrained
    assert cosine(mean_noise(results[-40:]), problem.direction) >= 0.7


def test_ast_finds_the_likeliest_way_to_fail():
    """The paper's reward leaves the last step free: failing is decided on the step before it."""
    direction = np.zeros((2, 2))
    direction[0] = 0.8, -0.6
    problem = HalfSpace(1e-4, direction)
    rates, cosines, lengths, gains = [], [], [], []
    for seed in range(3030, 3033):
        _, results = run_search(problem, "ast", 240, seed, **HELD_AST | LIKELIHOOD_COUNTS)
        untrained, trained = results[:30], results[-60:]
        found = mean_noise(trained)[0]
        rates.append(failure_rate(trained))
        cosines.append(cosine(found, direction[0]))
        lengths.append(np.linalg.norm(found) / problem.beta)
        gains.append(half_square(trained) / half_square(untrained))
    assert min(rates) >= 0.9
    assert min(cosines) >= 0.9
    # Of a single seed both vary by a fifth.
    assert np.median(lengths) <= 1.3
    assert np.median(gains) <= 0.7


def mean_noise(results):
    return np.mean([result.noise.z for result in failures(results)], axis=0)


def half_square(results):
    """-log p of the first step's noise in failures, but for a constant."""
    return np.mean([0.5 * np.sum(result.noise.z[0] ** 2) for result in failures(results)])


def test_the_adversary_of_a_function_remembers_its_last_noise():
    """Without it no reward could reach the step before the last: every other component is fixed."""
    _, results = run_search(HalfSpace(1e-4, turning(8)), "ast", 10, **HELD_AST)
    for result in results:
        seen = dict(zip(STATE, result.states.T, strict=True))
        told = np.stack([seen["noise_x"], seen["noise_y"]], axis=1)
        assert not told[0].any()
        assert cosine(told[1:], result.noise.z[:-1]) == pytest.approx(1.0, abs=1e-6)


def test_difs_samples_failures_far_more_often_than_the_prior_and_in_their_direction():
    problem = HalfSpace(1e-3, turning(8))
    _, results = run_search(problem, "difs", 600, first_steps=100, steps=60)
    sampled = results[-60:]
    assert failure_rate(sampled) >= 50 * problem.probability
    assert cosine(mean_noise(sampled), problem.direction) >= 0.75
