"""`mixture_ce`: its mixture fitted to modes and sampled, its elite, and its rounds."""

import numpy as np
import pytest
from borrowed_fixtures import borrow
from odd_problems import run_search

from eigenfail.errors import ProtocolError
from eigenfail.settings import read_settings
from eigenfail.values.episode import PriorSource
from eigenfail.values.learning import LearnerContext
from eigenfail_searches.mixture_ce.elite import has_elites, select_elite
from eigenfail_searches.mixture_ce.method import MixtureCrossEntropy
from eigenfail_searches.mixture_ce.modes import (
    Mixture,
    fit_mixture,
    make_prior_mixture,
    prepare_elite,
)
from eigenfail_searches.mixture_ce.settings import MixtureCeSettings
from eigenfail_services.methods.trials import TrialMemory

SHARES = np.array([0.3, 0.7])
MEANS = np.array([[3.0, 0.0, -1.0, 2.0], [-2.0, 1.0, 0.0, 0.0]])
HORIZON = 2


def make_learner(episodes=100, horizon=5, **settings):
    nothing = np.zeros((0, horizon, 2), np.float32)
    given = read_settings(MixtureCeSettings, settings, "settings")
    return MixtureCrossEntropy(LearnerContext(0, episodes, horizon, nothing), given)


def noise_of(proposal):
    return np.stack([source.z for source in proposal.sources])


def seen(z):
    return np.zeros(z.shape[:2], bool)


def fitted(z, shift=0, unseen=None):
    return fit_mixture(prepare_elite(z, seen(z) if unseen is None else unseen, shift), most=4)


@pytest.mark.parametrize("scale", [1.0, 0.5])
def test_a_known_mixture_is_sampled_with_its_shares_scaled_means_and_covariance(scale):
    learner = make_learner(horizon=HORIZON, scale=scale)
    learner._mixture = Mixture(SHARES, MEANS)
    z = noise_of(learner.exploit(8_000))
    assert z.dtype == np.float32
    means = scale * MEANS
    centre = SHARES @ means
    apart = means - centre
    flat = z.reshape(-1, 2 * HORIZON)
    np.testing.assert_allclose(flat.mean(axis=0), centre, atol=0.04)
    np.testing.assert_allclose(np.cov(flat.T), np.eye(4) + (SHARES * apart.T) @ apart, atol=0.08)


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
    random, one = np.random.default_rng(1), make_learner(initial=20)
    one.propose(100)
    sides = np.where(np.arange(20) % 2, 2.0, -2.0)
    noise = random.standard_normal((20, 5, 2)) + sides[:, None, None]
    one.observe([episode(z, 1.0 + i / 20) for i, z in enumerate(noise)])
    return one


def test_samples_are_shared_among_the_modes_and_a_restored_learner_goes_on(episode):
    one, other = trained(episode), make_learner(initial=20)
    other.restore(one.state())
    np.testing.assert_array_equal(other._mixture.means, one._mixture.means)
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
    assert len(one._mixture.shares) == 2
    assert (noise_of(one.exploit(6)).mean(axis=(1, 2)) < 0.0).all()
    assert np.count_nonzero(noise_of(one.propose(10)).mean(axis=(1, 2)) > 0.0) == 5


def test_once_the_elite_are_failures_no_more_modes_are_sought(episode):
    random, found = np.random.default_rng(1), []
    sides = np.where(np.arange(40) % 2, 2.0, -2.0)
    noise = random.standard_normal((40, 5, 2)) + sides[:, None, None]
    for robustness in (1.0, 0.0):
        one = make_learner(initial=20)
        one.propose(100)
        one.observe([episode(z, robustness) for z in noise])
        found.append(len(one._mixture.shares))
    assert found == [2, 1]


def test_means_are_averaged_over_neighbouring_steps():
    z = np.zeros((10, 30, 2))
    z[:, 2] = 3.0
    mean = fitted(z, shift=1).means.reshape(30, 2)[:, 0]
    assert mean.tolist() == pytest.approx([0.0, 1.0, 1.0, 1.0, *[0.0] * 26])


def keep(episode, robustness):
    trials = TrialMemory(6, 2, memory=100)
    trials.add([episode(np.ones((6, 2)), r) for r in robustness])
    return trials


def test_the_elite_are_the_least_robust_and_later_the_likelier_failures(episode):
    def select(count, likely_share):
        alike = np.zeros(len(trials), np.intp)
        return sorted(select_elite(trials, count, likely_share, alike).tolist())

    trials = keep(episode, (3.0, 1.0, 2.0, 4.0))
    assert select(2, 0.5) == [1, 2]
    trials.add([episode(np.full((6, 2), size)) for size in (3.0, 1.0, 2.0, 4.0, 1.5, 2.5)])
    assert select(2, 0.5) == [6, 8]
    assert select(2, 0.3) == [5, 8]
    assert select(2, 1.0) == [8, 9]


def test_every_kind_has_its_elite_until_the_others_have_failed_long_enough(episode):
    trials = keep(episode, [0.0, 0.0, 0.0, 0.0, 0.0, 5.0, 4.0, 6.0])
    kinds = np.array([0, 0, 0, 0, 0, 1, 1, 1])
    assert select_elite(trials, 4, 1.0, kinds).tolist() == [3, 4, 6, 5]
    assert not has_elites(trials, 4, kinds)
    trials.add([episode(np.ones((6, 2)), 0.0)] * 3)
    given_up = np.append(kinds, [0, 0, 0])
    assert select_elite(trials, 4, 1.0, given_up).tolist() == [4, 8, 9, 10]
    assert has_elites(trials, 4, given_up)
    both = np.append(kinds, [1, 1, 0])
    assert select_elite(trials, 4, 1.0, both).tolist() == [4, 10, 8, 9]
    assert has_elites(trials, 4, both)


def test_draws_from_the_prior_come_first_and_then_rounds_of_the_mixture(episode):
    learner, sizes = make_learner(episodes=1000), []
    for _ in range(3):
        sources = learner.propose(1000).sources
        sizes.append((len(sources), isinstance(sources[0], PriorSource)))
        learner.observe([episode(np.ones((5, 2)), 1.0) for _ in sources])
    assert sizes == [(80, True), (40, False), (40, False)]


def test_the_scale_falls_while_more_fail_than_aimed_at_and_rises_again(episode):
    learner, seen = make_learner(elite=4, target_rate=0.5, scale=1.0), []
    for failed in (0, 10, 0):
        for _ in range(3):
            count = len(learner.propose(10).sources)
            learner.observe(
                [episode(np.ones((5, 2)), 0.0 if i < failed else 5.0) for i in range(count)]
            )
        seen.append(learner._facts.scale)
    assert seen[0] == 1.0
    assert seen[1] < 1.0
    assert seen[1] < seen[2]


def test_a_state_of_another_horizon_is_refused():
    with pytest.raises(ProtocolError, match="should have shape"):
        make_learner(horizon=5).restore(make_learner(horizon=6).state())


PROBLEMS = borrow("services/methods/toys", "problems.py")


def test_corners_are_found_thousands_of_times_as_often_as_under_the_prior_and_mostly_both():
    """From 11 of the seeds 3030 to 3043 both are found: from the others one falls behind."""
    problem, both = PROBLEMS["TwoModes"](), 0
    for seed in range(3030, 3035):
        _, results = run_search(problem, "mixture_ce", 300, seed)
        sides = [result.noise.z[0, 0] < 0.0 for result in results if result.is_failure]
        assert len(sides) / len(results) >= 30_000 * problem.probability
        both += 0.2 < np.mean(sides) < 0.8
    assert both >= 3


def test_a_point_mass_is_driven_into_a_wall():
    problem = PROBLEMS["PointMassCorridor"]()
    _, results = run_search(problem, "mixture_ce", 300)
    rate = sum(result.is_failure for result in results) / len(results)
    assert rate >= 30 * problem.at_most
