"""The mixture that DiFS knows in closed form: fitted to modes, sampled, kept in the state."""

import numpy as np
import pytest
from difs_learners import make_difs, noise_of

from eigenfail_services.methods.difs.model import DiffusionModel
from eigenfail_services.methods.difs.modes import (
    Mixture,
    fit_mixture,
    make_prior_mixture,
    prepare_elite,
)
from eigenfail_services.methods.difs.settings import DifsSettings

SHARES = np.array([0.3, 0.7])
MEANS = np.array([[3.0, 0.0, -1.0, 2.0], [-2.0, 1.0, 0.0, 0.0]])
HORIZON = 2


def seen(z):
    return np.zeros(z.shape[:2], bool)


def fitted(z, shift=0, unseen=None):
    return fit_mixture(prepare_elite(z, seen(z) if unseen is None else unseen, shift), most=4)


@pytest.mark.parametrize("steps", [1, 20])
@pytest.mark.parametrize("guidance", [0.0, -0.5])
def test_a_known_mixture_is_sampled_with_its_shares_means_and_covariance(steps, guidance):
    settings = DifsSettings(device="cpu", sampling_steps=steps)
    model = DiffusionModel(settings, HORIZON, 2, 0)
    model.mixture = Mixture(SHARES, MEANS)
    z = model.sample(np.zeros(8_000, np.float32), guidance, draw=1).reshape(-1, 2 * HORIZON)
    means = (1.0 + guidance) * MEANS
    centre = SHARES @ means
    apart = means - centre
    np.testing.assert_allclose(z.mean(axis=0), centre, atol=0.04)
    np.testing.assert_allclose(np.cov(z.T), np.eye(4) + (SHARES * apart.T) @ apart, atol=0.08)


@pytest.mark.parametrize("count", [1, 7, 1000])
def test_components_are_drawn_by_their_shares_to_the_nearest_one(count):
    mixture = Mixture(np.array([0.2, 0.5, 0.3]), np.zeros((3, 4)))
    drawn = [mixture.draw_components(count, np.random.default_rng(seed)) for seed in range(400)]
    held = np.array([np.bincount(each, minlength=3) for each in drawn])
    assert np.abs(held - count * mixture.shares).max() < 1.0
    np.testing.assert_allclose(held.mean(axis=0) / count, mixture.shares, atol=0.1)


def test_responsibilities_follow_bayes_where_noise_was_seen():
    random = np.random.default_rng(0)
    z = random.standard_normal((6, HORIZON, 2))
    unseen = np.array([[False, False], [False, True]] * 3)
    found = Mixture(SHARES, MEANS).compute_responsibilities(z, unseen)
    for each, one, hidden in zip(found, z, unseen, strict=True):
        away = (one - MEANS.reshape(2, HORIZON, 2))[:, ~hidden]
        density = SHARES * np.exp(-0.5 * (away**2).sum(axis=(1, 2)))
        np.testing.assert_allclose(each, density / density.sum(), rtol=1e-6)
    np.testing.assert_allclose(found.sum(axis=1), 1.0)


@pytest.mark.parametrize("steps", [1, 50])
@pytest.mark.parametrize("count", [20, 60])
def test_one_mode_stays_one_component_and_its_mean_is_the_average(steps, count):
    found = []
    for seed in range(10):
        z = np.random.default_rng(seed).standard_normal((count, steps, 2)) + 1.5
        found.append(fitted(z))
        if len(found[-1].shares) == 1:
            np.testing.assert_allclose(found[-1].means[0], z.mean(axis=0).ravel(), atol=1e-12)
    assert sum(len(each.shares) == 1 for each in found) >= 9


def test_accidents_of_long_noise_are_no_modes():
    for seed in range(10):
        z = np.random.default_rng(seed).standard_normal((20, 100, 2))
        assert len(fitted(z, shift=3).shares) == 1


@pytest.mark.parametrize("modes", [2, 3, 4])
def test_each_mode_is_found_with_its_share_and_its_mean(modes):
    random = np.random.default_rng(modes)
    means = 4.0 * np.stack([np.eye(4)[k].reshape(2, 2) for k in range(modes)])
    label = np.arange(200) * modes // 200
    found = fitted(means[label] + random.standard_normal((200, 2, 2)))
    assert len(found.shares) == modes
    for mean in means.reshape(modes, -1):
        nearest = np.linalg.norm(found.means - mean, axis=1).argmin()
        assert found.shares[nearest] == pytest.approx(1.0 / modes, abs=0.04)
        np.testing.assert_allclose(found.means[nearest], mean, atol=0.6)


def test_one_long_mode_without_a_gap_is_not_taken_apart():
    for seed in range(5):
        random = np.random.default_rng(seed)
        z = 0.3 * random.standard_normal((40, 1, 2))
        z[:, 0, 0] += 2.0 * random.standard_normal(40)
        assert len(fitted(z).shares) == 1


def test_modes_nearer_than_two_sigma_are_one():
    z = 0.1 * np.random.default_rng(0).standard_normal((40, 1, 2))
    z[::2, 0, 0] += 1.8
    assert len(fitted(z).shares) == 1
    z[::2, 0, 0] += 0.4
    assert len(fitted(z).shares) == 2


@pytest.mark.parametrize("count", [1, 3, 9, 40])
def test_few_or_equal_trajectories_are_one_component(count):
    z = np.ones((count, 3, 2))
    unseen = np.ones((count, 3), bool)
    np.testing.assert_allclose(fitted(z).means, np.ones((1, 6)))
    assert fitted(z, unseen=unseen).means.tolist() == [[0.0] * 6]


def test_before_training_there_is_the_prior_alone():
    prior = make_prior_mixture(4)
    assert prior.shares.tolist() == [1.0]
    assert not prior.means.any()


def trained(episode):
    """A learner that has seen two kinds of noise, each with the same robustness."""
    random, one = np.random.default_rng(1), make_difs(initial_share=0.2)
    one.propose(100)
    sides = np.where(np.arange(20) % 2, 2.0, -2.0)
    noise = random.standard_normal((20, 5, 2)) + sides[:, None, None]
    one.observe([episode(z, 1.0 + i / 20) for i, z in enumerate(noise)])
    return one


def test_samples_are_shared_among_the_modes_and_a_restored_learner_goes_on(episode):
    one, other = trained(episode), make_difs(initial_share=0.2)
    other.restore(one.state())
    np.testing.assert_array_equal(other._model.mixture.means, one._model.mixture.means)
    proposed = noise_of(one.propose(10))
    np.testing.assert_array_equal(proposed, noise_of(other.propose(10)))
    assert np.count_nonzero(proposed.mean(axis=(1, 2)) > 0.0) == 5
    assert (noise_of(one.exploit(6)).mean(axis=(1, 2)) > 0.0).sum() == 3
    other.exploit(6)
    for each in (one, other):
        each.observe([episode(z, 1.0) for z in proposed])
    np.testing.assert_array_equal(noise_of(one.propose(10)), noise_of(other.propose(10)))


def test_at_robustness_zero_only_the_modes_that_have_failed_are_sampled(episode):
    one = trained(episode)
    one.observe([episode(np.full((5, 2), -2.0))])
    assert len(one._model.mixture.shares) == 2
    assert (noise_of(one.exploit(6)).mean(axis=(1, 2)) < 0.0).all()
    assert np.count_nonzero(noise_of(one.propose(10)).mean(axis=(1, 2)) > 0.0) == 5


def test_once_the_elite_are_failures_no_more_modes_are_sought(episode):
    random, found = np.random.default_rng(1), []
    sides = np.where(np.arange(40) % 2, 2.0, -2.0)
    noise = random.standard_normal((40, 5, 2)) + sides[:, None, None]
    for robustness in (1.0, 0.0):
        one = make_difs(initial_share=0.2)
        one.propose(100)
        one.observe([episode(z, robustness) for z in noise])
        found.append(len(one._model.mixture.shares))
    assert found == [2, 1]
