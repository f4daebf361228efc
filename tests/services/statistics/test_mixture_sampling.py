"""Mixture sampling on failures of known probability."""

from collections import deque
from functools import cache
from math import sqrt
from statistics import NormalDist

import numpy as np
import pytest

from eigenfail_services.statistics.batches import Requester
from eigenfail_services.statistics.gaussian_mixture import (
    MixtureProposal,
    NormalComponent,
    make_prior_proposal,
    make_round_component,
    make_scaled_proposal,
)
from eigenfail_services.statistics.mixture_sampling import (
    LEAST_PROMISE,
    MixtureResult,
    MixtureSampling,
    ProposalDraws,
    count_needed,
    fit_tail,
    make_result,
    weigh_by_balance,
)
from eigenfail_services.statistics.subset_simulation import PlainDraws, SubsetSimulation

SHAPE = 3, 2
REACH = 3.7
ONE_SIDE = NormalDist().cdf(-REACH)


def project(z):
    return z.reshape(len(z), -1).sum(axis=1) / sqrt(z[0].size)


def simulate(robustness, seed, budget=2000, shape=SHAPE):
    """Return a finished simulation, and the noise that it requested."""
    simulation, requested = MixtureSampling(shape, budget, 8, (seed,)), []
    requester = Requester(simulation.run())
    waiting = deque(requester.start())
    while waiting:
        requested.append(waiting.popleft())
        waiting.extend(requester.answer(robustness(requested[-1])))
    return simulation, np.concatenate(requested)


sample = cache(simulate)
"""The same for several tests, which change nothing of it."""


@pytest.mark.parametrize("shape", [(6, 1), (2, 3)])
def test_values_of_other_channels_count_like_those_of_other_steps(shape):
    found, z = sample(one_side, 3, shape=shape)
    usual, same = sample(one_side, 3)
    assert z.shape[1:] == shape
    assert np.array_equal(z.reshape(same.shape), same)
    assert found.result.probability == usual.result.probability


def one_side(z):
    return np.maximum(REACH - project(z), 0.0)


def two_sides(z):
    return np.maximum(REACH - np.abs(project(z)), 0.0)


def test_the_mean_over_seeds_is_the_probability_of_a_half_space():
    found = [sample(one_side, seed)[0].result.probability for seed in range(5)]
    assert np.mean(found) == pytest.approx(ONE_SIDE, rel=0.15)
    assert np.std(found) < 0.3 * ONE_SIDE


def test_two_opposite_regions_are_both_counted():
    found = [sample(two_sides, seed)[0].result for seed in range(3)]
    assert np.mean([one.probability for one in found]) == pytest.approx(2.0 * ONE_SIDE, rel=0.2)
    assert min(one.probability for one in found if one.effective > 25.0) > 1.3 * ONE_SIDE


def test_the_whole_budget_is_used_and_the_same_seed_gives_the_same_noise():
    simulation, z = simulate(one_side, 3, budget=1500)
    assert len(z) == simulation.episodes_run == 1500
    assert (simulate(one_side, 3, budget=1500)[1] == z).all()
    assert not (sample(one_side, 4, budget=1500)[1][:100] == z[:100]).all()


def test_an_episode_that_errored_counts_as_no_failure():
    """Beyond some strength the noise cannot be run, where the mixture draws more than p(z)."""
    width = 1.0

    def with_errors(z):
        return np.where(project(z) > REACH + width, np.nan, one_side(z))

    results = [sample(with_errors, seed, budget=4000)[0].result for seed in range(6)]
    truth = ONE_SIDE - NormalDist().cdf(-REACH - width)
    found = [one for one in results if one is not None and one.effective > 25.0]
    assert len(found) >= 3
    assert all(0 < one.errored < one.draws for one in found)
    assert np.mean([one.probability for one in found]) == pytest.approx(truth, rel=0.25)


def test_where_failures_are_not_rare_nothing_is_fitted():
    simulation, z = sample(lambda z: project(z) - 1.0, 1, budget=600)
    assert not simulation.are_failures_rare
    assert simulation.result is None
    assert isinstance(simulation.successor, PlainDraws)
    assert len(z) == 600


def test_the_signs_of_the_axes_do_not_change_the_draws():
    axes = np.linalg.qr(np.random.default_rng(2).normal(size=(3, 3)))[0]
    variances = np.array([0.3, 0.8, 1.4])
    one = NormalComponent(np.ones(3), axes, variances)
    other = one._replace(axes=axes * np.array([1.0, -1.0, -1.0]))
    standard = np.random.default_rng(3).normal(size=(50, 3))
    assert one.transform(standard) == pytest.approx(other.transform(standard), abs=1e-12)


def test_failures_that_no_wide_noise_meets_leave_no_result():
    simulation, z = sample(lambda z: np.ones(len(z)), 1, budget=600)
    assert simulation.result is None
    assert simulation.found_failures == 0
    assert isinstance(simulation.successor, SubsetSimulation)
    assert len(z) == 600


def test_mixture_whose_trial_promises_too_little_leaves_its_last_draws_to_another():
    # A few hundred draws cannot fit normals to failures in 80 dimensions.
    simulation, z = sample(one_side, 5, budget=1000, shape=(40, 2))
    assert 900 < len(z) <= 1000
    assert simulation.result is None
    assert simulation.promised < LEAST_PROMISE * count_needed(80)
    assert isinstance(simulation.successor, SubsetSimulation)


def test_the_coefficient_of_variation_is_that_of_the_bootstrap():
    result = sample(one_side, 2)[0].result
    random, values = np.random.default_rng(0), np.zeros(result.draws)
    values[: len(result.weights)] = result.weights
    means = [random.choice(values, result.draws).mean() for _ in range(2000)]
    of_draws = result._replace(at_ends=np.zeros(0), at_unseen=np.zeros(0)).cv
    assert np.std(means) / np.mean(means) == pytest.approx(of_draws, rel=0.1)
    assert of_draws <= result.cv < 2.0 * of_draws


def test_balanced_weights_add_up_to_the_probability():
    random, size = np.random.default_rng(3), 2
    proposals = [make_prior_proposal(size), make_scaled_proposal(size, 2.0)]
    seen = []
    for proposal, count in zip(proposals, (20_000, 20_000), strict=True):
        z = proposal.draw(count, random)
        seen.append(ProposalDraws(z, z[:, 0] > 2.0, proposal))
    _, log_weights = weigh_by_balance(seen)
    assert np.exp(log_weights).sum() == pytest.approx(NormalDist().cdf(-2.0), rel=0.03)


def test_a_region_that_the_mixture_has_lost_is_noticed():
    """Chains end on both sides; the mixture draws on one of them."""
    random = np.random.default_rng(6)
    shares = np.array([0.05, 0.95])
    mean = np.array([4.0, 0.0])
    proposal = MixtureProposal(
        shares, (*make_prior_proposal(2).components, make_round_component(mean)), 1
    )
    z = proposal.draw(2000, random)
    last = ProposalDraws(z, np.abs(z[:, 0]) > 3.7, proposal)
    right = np.stack([random.normal(4.0, 0.3, 20), random.normal(0.0, 1.0, 20)], axis=1)
    known = make_result(last, 2000, right, np.full(20, True))
    lost = make_result(last, 2000, np.concatenate([right, -right]), np.full(40, True))
    fitted = make_result(last, 2000, np.concatenate([right, -right]), np.arange(40) < 20)
    assert known.uncovered == 0.0
    assert lost.uncovered == pytest.approx(0.5, abs=0.05)
    assert lost.probability == pytest.approx(ONE_SIDE, rel=0.15)
    # The chains on the left have been fitted to: they widen the interval all the same.
    assert fitted.uncovered == 0.0
    assert fitted.cv == pytest.approx(lost.cv, rel=0.2)
    assert known.cv < 0.5 * lost.cv


@pytest.mark.parametrize("shape", [0.3, 0.7, 1.2])
def test_the_tail_index_of_pareto_weights_is_found(shape):
    weights = np.random.default_rng(4).pareto(1.0 / shape, 40_000) + 1.0
    assert fit_tail(weights).shape == pytest.approx(shape, abs=0.1)


def test_the_tail_index_of_weights_without_a_tail():
    random = np.random.default_rng(5)
    assert fit_tail(random.exponential(1.0, 40_000)).shape == pytest.approx(0.0, abs=0.15)
    assert fit_tail(random.random(40_000)).shape < 0.0
    assert fit_tail(np.ones(1000)).shape == 0.0
    assert fit_tail(np.ones(20)) is None


def test_the_variance_counts_heavy_weights_that_are_missing():
    """Of 60 weights with a Pareto tail, the sample's own variance is often far too small."""
    random, shape = np.random.default_rng(5), 0.3
    # Mean 1 / (1 - k), mean square 2 / ((1 - k) * (1 - 2 * k)).
    true = 2.0 * (1.0 - shape) / (1.0 - 2.0 * shape) / 60
    plain, told = [], []
    for _ in range(300):
        weights = (random.random(60) ** -shape - 1.0) / shape
        result = MixtureResult(10_000, 0, weights, np.zeros(0), np.zeros(0), 0.0)
        plain.append(1.0 / result.effective - 1.0 / result.draws)
        told.append(result.cv**2)
    assert np.mean(np.array(plain) < 0.7 * true) > 0.3
    assert np.mean(np.array(told) < 0.7 * true) < 0.05
    assert np.median(told) < 2.0 * true


def test_the_variance_counts_a_region_that_the_draws_half_lost():
    """Weights of failures that no fit has seen have the mean E_q[w²] / P."""
    weights = np.full(300, 0.01)
    none = np.zeros(0)
    agreeing = MixtureResult(1000, 0, weights, np.full(36, 0.01), np.full(12, 0.01), 0.0)
    assert agreeing.cv == pytest.approx(sqrt((0.01 / 0.003 - 1.0) / 1000))
    heavier = MixtureResult(1000, 0, weights, none, np.full(12, 0.3), 0.0)
    assert heavier.cv == pytest.approx(sqrt((0.3 / 0.003 - 1.0) / 1000))
    # Of few of them the mean is not known well: two standard errors are added.
    unequal = np.repeat([0.2, 0.4], 6)
    upper = 0.3 + 2.0 * np.std(unequal, ddof=1) / sqrt(12)
    for ends in ((unequal, none), (none, unequal)):
        result = MixtureResult(1000, 0, weights, *ends, 0.0)
        assert result.cv == pytest.approx(sqrt((upper / 0.003 - 1.0) / 1000))
