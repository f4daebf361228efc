"""The Gaussian that CEM draws from, its weights, its fit, and the choice of the elite."""

from statistics import NormalDist

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eigenfail.values.episode import Outcome
from eigenfail.values.measures import Measures
from eigenfail_services.methods import cem

NORMAL = NormalDist()
WIDE = cem.GaussianProposal(
    np.float32([[1.0, -0.5], [0.0, 2.0], [0.5, 0.0]]),
    np.float32([[1.0, 2.0], [0.5, 1.0], [1.5, 0.8]]),
)


def densities(distribution, z):
    return [np.log(distribution(*at).pdf(float(z[at]))) for at in np.ndindex(z.shape)]


@given(st.integers(0, 3), st.integers(0, 2**32))
def test_a_weight_is_the_ratio_of_the_densities_up_to_the_episodes_end(steps, seed):
    z = np.random.default_rng(seed).standard_normal((steps, 2), np.float32)
    p = densities(lambda *_: NORMAL, z)
    q = densities(lambda *at: NormalDist(float(WIDE.mean[at]), float(WIDE.std[at])), z)
    np.testing.assert_allclose(cem.log_weights([z], WIDE), [sum(p) - sum(q)], atol=1e-9)


@pytest.mark.parametrize("channels", [1, 2, 5])
def test_weights_of_the_prior_are_exactly_one(channels):
    prior = cem.make_prior(7, channels)
    z = prior.draw(5, np.random.default_rng(0))
    assert z.shape == (5, 7, channels)
    assert not cem.log_weights(list(z), prior).any()


@pytest.mark.parametrize("channels", [1, 3, 5])
def test_each_channel_is_fitted_by_itself(channels):
    z = np.random.default_rng(1).standard_normal((6, 4, channels)).astype(np.float32)
    elite = [row[: 4 - (n == 2)] for n, row in enumerate(z)]
    mean, std = cem.fit_gaussian(elite, cem.make_prior(4, channels))
    for n in range(channels):
        alone = cem.fit_gaussian([row[:, [n]] for row in elite], cem.make_prior(4, 1))
        np.testing.assert_array_equal(np.stack([mean[:, [n]], std[:, [n]]]), np.stack(alone))
        averaged = cem.average_over_steps(mean, 3)[:, [n]]
        np.testing.assert_array_equal(averaged, cem.average_over_steps(mean[:, [n]], 3))


def test_weights_recover_a_probability_from_draws_elsewhere():
    # z_0x + z_1x > 5.26 has P = Q(5.26 / sqrt 2); drawn around the likeliest failure.
    mean = np.zeros((3, 2), np.float32)
    mean[:2, 0] = 2.63
    proposal = cem.GaussianProposal(mean, np.ones((3, 2), np.float32))
    z = proposal.draw(20_000, np.random.default_rng(3))
    failed = z[:, 0, 0] + z[:, 1, 0] > 5.26
    # What comes after the end of an episode does not change the expectation.
    stopped = [row[: 2 if crashed else 3] for row, crashed in zip(z, failed, strict=True)]
    found = np.mean(np.exp(cem.log_weights(stopped, proposal)) * failed)
    assert found == pytest.approx(NORMAL.cdf(-5.26 / 2**0.5), rel=0.05)


def test_draws_have_the_proposals_moments_and_travel():
    z = WIDE.draw(40_000, np.random.default_rng(0))
    assert z.dtype == np.float32
    np.testing.assert_allclose(z.mean(axis=0), WIDE.mean, atol=0.05)
    np.testing.assert_allclose(z.std(axis=0), WIDE.std, rtol=0.03)


def test_the_fit_is_mean_and_standard_deviation_with_bessels_correction():
    z = np.random.default_rng(1).standard_normal((5, 3, 2), np.float32)
    mean, std = cem.fit_gaussian(list(z), WIDE)
    np.testing.assert_allclose(mean, z.mean(axis=0), atol=1e-6)
    np.testing.assert_allclose(std, z.std(axis=0, ddof=1), atol=1e-6)


def test_behind_its_end_an_episode_stands_for_the_prior():
    short, long, longer = np.float32([[1, 1]]), np.float32([[3, 1], [2, 2]]), np.ones((2, 2))
    mean, std = cem.fit_gaussian([short, long, longer.astype(np.float32), short], WIDE)
    # First step: x is 1, 3, 1, 1. Second: of four, two run, with x 2 and 1; the others are N(0, 1).
    np.testing.assert_allclose(mean[:, 0], [1.5, 0.75, 0.0])
    running = 0.5 * (0.5 + 1.5**2)
    np.testing.assert_allclose(std[:, 0] ** 2, [1.0, running + 0.5 - 0.75**2, 1.0])


def test_of_a_single_episode_the_spread_is_not_known():
    mean, std = cem.fit_gaussian([np.float32([[2, 2], [1, 1]])], WIDE)
    np.testing.assert_allclose(mean, [[2, 2], [1, 1], [0, 0]])
    np.testing.assert_allclose(std, [*WIDE.std[:2], [1, 1]], atol=1e-7)


@pytest.mark.parametrize(
    ("window", "expected"),
    [
        (1, [0.0, 6.0, 0.0, 3.0]),
        (2, [3.0, 3.0, 1.5, 3.0]),
        (3, [3.0, 2.0, 3.0, 1.5]),
        (99, [2.25, 2.25, 2.25, 2.25]),
    ],
)
def test_moving_averages_by_hand(window, expected):
    values = np.stack([[0.0, 6.0, 0.0, 3.0], np.zeros(4)], axis=1)
    np.testing.assert_allclose(cem.average_over_steps(values, window)[:, 0], expected)


def noise(x):
    return np.full((2, 2), x, np.float32)


def chosen(results, share=0.25, proposal=None):
    best = cem.select_elite(results, proposal or cem.make_prior(2, 2), share)
    return [float(z[0, 0]) for z in best]


def test_the_elite_are_the_least_robust(episode):
    assert chosen([episode(noise(i), r) for i, r in enumerate([4, 1, 3, 2])], 0.5) == [1, 3]


def test_failures_fewer_than_the_elite_are_all_in_it(episode):
    assert chosen([episode(noise(i), r) for i, r in enumerate([4, 1, 3, 0])], 0.5) == [1, 3]


def test_among_many_failures_the_likeliest_are_chosen(episode):
    proposal = cem.GaussianProposal(noise(2.0), noise(1.0))
    results = [episode(noise(x), 0.0) for x in (3.0, 2.5, 2.0, 3.5)]
    assert chosen(results, 0.25, proposal) == [2.0]
    assert chosen(results, 0.5, proposal) == [2.5, 2.0]


def test_an_early_failure_is_no_likelier_for_being_short(episode):
    proposal = cem.GaussianProposal(noise(2.0), noise(1.0))
    # The short one did more than the proposal's mean, the long one less in every step.
    results = [episode(noise(3.0)[:1], 0.0), episode(noise(1.5), 0.0)]
    assert chosen(results, 0.5, proposal) == [1.5]


def test_noise_that_does_not_matter_is_not_chosen_for_being_small(episode):
    # Everything fails under the prior: it is the distribution of failures already.
    assert chosen([episode(noise(x), 0.0) for x in (0.1, 1.0, 2.0, 3.0)]) == []


@pytest.mark.parametrize(
    ("robustness", "expected"),
    [([5, 5, 5, 5], []), ([5, 5, 5, 9], [0, 1, 2]), ([1, 5, 5, 5], [0])],
)
def test_whoever_ties_with_the_last_of_the_elite_belongs_to_it(episode, robustness, expected):
    assert chosen([episode(noise(i), r) for i, r in enumerate(robustness)]) == expected


def test_episodes_that_failed_to_run_are_never_in_it(episode):
    fault = {"outcome": Outcome.ERRORED, "measures": None}
    stopped = {"outcome": Outcome.ERRORED, "measures": Measures(0.0)}
    results = [episode(noise(7), **fault), episode(noise(8), **stopped)]
    assert chosen(results, 0.9) == []
    running = [episode(noise(1), 2.0), episode(noise(2), 1.0)]
    assert chosen([*results, *running], 0.5) == [2]
    unknown = episode(noise(9), 1.0, measures=Measures(float("nan")))
    assert chosen([unknown, *running], 0.5) == [2]
