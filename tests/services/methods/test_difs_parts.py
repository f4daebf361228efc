"""The diffusion process against closed forms, and what the model is trained on."""

from math import pi

import numpy as np
import pytest
import torch

from eigenfail.values.episode import Outcome
from eigenfail.values.measures import Measures
from eigenfail_services.methods.difs import model as diffusion
from eigenfail_services.methods.difs.model import DiffusionModel, shift_in_time
from eigenfail_services.methods.difs.network import Denoiser
from eigenfail_services.methods.difs.settings import DifsSettings, Examples, TrialMemory

HORIZON = 6


def model(channels=2, horizon=HORIZON, **changes):
    given = {
        "width": 16,
        "learning_rate": 3e-3,
        "weight_decay": 0.0,
        "batch_size": 64,
        "ema": 0.98,
        "jitter": 0,
        "device": "cpu",
    }
    return DiffusionModel(DifsSettings(**{**given, **changes}), horizon, channels, seed=0)


def test_velocity_and_noised_data_are_a_rotation():
    x0, eps = torch.randn(2, 5, 3, generator=torch.Generator().manual_seed(0))
    angle = torch.linspace(0.0, pi / 2, 5)
    x, v = diffusion.diffuse(x0, eps, angle), diffusion.compute_velocity(x0, eps, angle)
    torch.testing.assert_close(torch.cos(angle)[:, None] * x - torch.sin(angle)[:, None] * v, x0)
    torch.testing.assert_close(torch.sin(angle)[:, None] * x + torch.cos(angle)[:, None] * v, eps)


@pytest.mark.parametrize("channels", [1, 3, 5])
def test_the_mean_of_every_channel_is_learnt_up_to_the_ends(channels):
    push = np.arange(1.0, 1.0 + HORIZON * channels, dtype=np.float32).reshape(HORIZON, channels)
    unseen = np.zeros((10, HORIZON), bool)
    unseen[:, 4:] = True
    learner = model(channels=channels)
    learner.train(examples(np.tile(push, (10, 1, 1)), unseen=unseen), steps=3, draw=1)
    z = learner.sample(np.zeros(2000, np.float32), guidance=0.0, draw=2)
    assert z.shape == (2000, HORIZON, channels)
    np.testing.assert_allclose(z.mean(axis=0)[:4], push[:4], atol=0.2)
    np.testing.assert_allclose(z.mean(axis=0)[4:], 0.0, atol=0.2)


def test_the_untrained_model_samples_the_prior():
    z = model().sample(np.full(4000, 0.3, np.float32), guidance=2.0, draw=1)
    assert z.shape == (4000, HORIZON, 2)
    assert z.dtype == np.float32
    flat = z.reshape(len(z), -1)
    assert np.abs(flat.mean(axis=0)).max() < 0.07
    assert np.abs(np.cov(flat.T) - np.eye(2 * HORIZON)).max() < 0.09


def examples(z, condition=None, unseen=None, elite=None):
    count = len(z)
    return Examples(
        z=np.asarray(z, np.float32),
        unseen=np.zeros(z.shape[:2], bool) if unseen is None else unseen,
        condition=np.zeros(count, np.float32) if condition is None else condition,
        held_out=np.arange(count) % 5 == 0,
        elite=np.ones(count, bool) if elite is None else elite,
        modes=4,
    )


def test_the_mean_is_learnt_from_few_and_unseen_steps_are_filled_from_the_prior():
    random = np.random.default_rng(0)
    z = random.standard_normal((20, HORIZON, 2))
    z[:, :3, 0] += 2.0
    z[:, 4:] = 0.0
    unseen = np.tile(np.arange(HORIZON) >= 4, (20, 1))
    learner = model()
    learner.train(examples(z, unseen=unseen), steps=200, draw=1)
    samples = learner.sample(np.zeros(4000, np.float32), guidance=0.0, draw=2)
    np.testing.assert_allclose(samples.mean(axis=0)[:4], z.mean(axis=0)[:4], atol=0.25)
    assert abs(samples[:, 4:].mean()) < 0.1
    assert samples[:, 4:].std() == pytest.approx(1.0, abs=0.05)


def test_guidance_scales_what_the_condition_adds_to_the_prior():
    learner = model()
    learner.train(examples(np.full((20, HORIZON, 2), 2.0)), steps=0, draw=1)
    for guidance, mean in ((-0.5, 1.0), (0.0, 2.0), (0.5, 3.0)):
        samples = learner.sample(np.zeros(4000, np.float32), guidance, draw=2)
        assert samples.mean() == pytest.approx(mean, abs=0.03)
        assert samples.std() == pytest.approx(1.0, abs=0.02)


def test_two_modes_are_two_components_and_the_correction_learns_their_width():
    random = np.random.default_rng(0)
    z = 0.3 * random.standard_normal((400, HORIZON, 2))
    z[:, :, 0] += np.where(random.random(400) < 0.5, -1.5, 1.5)[:, None]
    learner = model()
    learner.train(examples(z), steps=400, draw=1)
    side = learner.sample(np.zeros(1000, np.float32), guidance=0.0, draw=2)[..., 0].mean(axis=1)
    assert len(learner.mixture.shares) == 2
    assert float(learner._average.trust) > 0.8
    assert np.mean(np.abs(side) > 0.9) > 0.85
    assert 0.35 < np.mean(side > 0.0) < 0.65


def test_the_correction_depends_on_the_condition():
    random = np.random.default_rng(0)
    condition = (np.arange(600) % 2).astype(np.float32)
    z = random.standard_normal((600, HORIZON, 2)) + np.where(condition, 0.25, -0.25)[:, None, None]
    learner = model()
    learner.train(examples(z, condition), steps=250, draw=1)
    assert len(learner.mixture.shares) == 1
    low, high = (learner.sample(np.full(500, c, np.float32), 0.0, draw=2) for c in (0.0, 1.0))
    assert low.mean() == pytest.approx(-0.25, abs=0.08)
    assert high.mean() == pytest.approx(0.25, abs=0.08)


def test_accidents_of_few_trajectories_are_not_trusted():
    horizon, random = 50, np.random.default_rng(0)
    learner = model(horizon=horizon, width=32)
    learner.train(examples(random.standard_normal((20, horizon, 2))), steps=300, draw=1)
    assert float(learner._average.trust) < 0.3


def test_a_push_at_any_time_is_learnt_by_weights_shared_over_time():
    horizon, random = 24, np.random.default_rng(0)

    def pushes(count):
        z = random.standard_normal((count, horizon, 2))
        for one, begin in zip(z, random.integers(0, horizon - 6, count), strict=True):
            one[begin : begin + 6, 0] += 2.5
        return z

    learner = model(horizon=horizon)
    learner.train(examples(pushes(200)), steps=350, draw=1)
    samples = learner.sample(np.zeros(500, np.float32), guidance=0.0, draw=2)
    assert float(learner._average.trust) > 0.7
    assert strongest_push(samples).mean() > 0.8 * strongest_push(pushes(500)).mean()
    assert strongest_push(random.standard_normal((500, horizon, 2))).mean() < 1.5


def strongest_push(z):
    """Largest mean of six successive steps, shape (n,)."""
    sums = np.cumsum(z[..., 0], axis=1)
    return ((sums[:, 6:] - sums[:, :-6]) / 6.0).max(axis=1)


def test_the_mixture_is_fitted_to_the_elite_and_the_network_to_all():
    z = np.random.default_rng(0).standard_normal((40, HORIZON, 2)) + 1.0
    z[20:] += 1.0
    learner, elite = model(), np.arange(40) < 20
    learner.train(examples(z, elite=elite), steps=5, draw=1)
    means = learner.mixture.means.reshape(HORIZON, 2)
    np.testing.assert_allclose(means, z[:20].mean(axis=0), atol=1e-6)


@pytest.mark.parametrize("channels", [1, 2, 5])
@pytest.mark.parametrize("horizon", [1, 2, 33, 34, 100])
def test_every_shape_has_its_network_and_its_far_steps_depend_on_each_other(horizon, channels):
    network = Denoiser(horizon, channels, width=8)
    torch.nn.init.ones_(network.last.weight)
    x = torch.zeros(3, channels * horizon)
    moved = x.clone()
    moved[:, 0] = 5.0
    angle, condition = torch.full((3,), 0.7), torch.zeros(3)
    before, after = (network.correct(each, angle, condition, x) for each in (x, moved))
    assert before.shape == x.shape
    assert not torch.allclose(before[:, -1], after[:, -1])


def test_a_trajectory_is_shifted_in_time_and_what_moves_in_is_unseen():
    z = torch.arange(1.0, 5.0)[None, :, None].expand(2, 4, 2)
    unseen = torch.tensor([[False, False, False, True]] * 2)
    moved, hidden = shift_in_time(z, unseen, torch.tensor([[1], [-2]]))
    assert moved[0, 1:, 0].tolist() == [1.0, 2.0, 3.0]
    assert hidden[0].tolist() == [True, False, False, False]
    assert moved[1, :2, 0].tolist() == [3.0, 4.0]
    assert hidden[1].tolist() == [False, True, True, True]


def test_jitter_averages_the_mean_over_time():
    z = np.zeros((10, 30, 2))
    z[:, 2] = 3.0
    learner = model(horizon=30, jitter=1)
    learner.train(examples(z), steps=0, draw=1)
    mean = learner.mixture.means.reshape(30, 2)[:, 0]
    assert mean.tolist() == pytest.approx([0.0, 1.0, 1.0, 1.0, *[0.0] * 26])


def test_the_elite_are_the_least_robust_and_later_the_likelier_failures(episode):
    trials = TrialMemory(HORIZON, 2, memory=100)
    trials.add([episode(np.ones((6, 2)), r) for r in (3.0, 1.0, 2.0, 4.0)])
    assert alike(trials, 2, 0.5) == [1, 2]
    trials.add([episode(np.full((6, 2), size)) for size in (3.0, 1.0, 2.0, 4.0, 1.5, 2.5)])
    assert alike(trials, 2, 0.5) == [6, 8]
    assert alike(trials, 2, 0.3) == [5, 8]
    assert alike(trials, 2, 1.0) == [8, 9]


def alike(trials, count, likely_share):
    """The elite where all are of one kind."""
    return sorted(trials.select_elite(count, likely_share, np.zeros(len(trials), np.intp)).tolist())


def test_every_kind_has_its_elite_until_the_others_have_failed_long_enough(episode):
    trials = TrialMemory(HORIZON, 2, memory=100)
    robustness = [0.0, 0.0, 0.0, 0.0, 0.0, 5.0, 4.0, 6.0]
    trials.add([episode(np.ones((6, 2)), r) for r in robustness])
    kinds = np.array([0, 0, 0, 0, 0, 1, 1, 1])
    assert trials.select_elite(4, 1.0, kinds).tolist() == [3, 4, 6, 5]
    assert not trials.has_elites(4, kinds)
    trials.add([episode(np.ones((6, 2)), 0.0)] * 3)
    given_up = np.append(kinds, [0, 0, 0])
    assert trials.select_elite(4, 1.0, given_up).tolist() == [4, 8, 9, 10]
    assert trials.has_elites(4, given_up)
    both = np.append(kinds, [1, 1, 0])
    assert trials.select_elite(4, 1.0, both).tolist() == [4, 10, 8, 9]
    assert trials.has_elites(4, both)


def test_steps_behind_an_episodes_end_are_unseen(episode):
    trials = TrialMemory(4, 2, memory=100)
    trials.add([episode(np.ones((2, 2))), episode(np.ones((4, 2)), 3.0)])
    np.testing.assert_array_equal(trials.find_unseen(), [[0, 0, 1, 1], [0, 0, 0, 0]])
    np.testing.assert_array_equal(trials.z[:, :, 0], [[1, 1, 0, 0], [1, 1, 1, 1]])


def test_failed_episodes_are_not_remembered_and_the_safest_make_room(episode):
    trials = TrialMemory(HORIZON, 2, memory=3)
    robustness = [5.0, 1.0, 4.0, 2.0, 3.0]
    trials.add([episode([(i, 0)], r) for i, r in enumerate(robustness)])
    trials.add([episode([(9, 0)], 0.5, outcome=Outcome.ERRORED), episode([], 0.1, measures=None)])
    assert trials.robustness.tolist() == [1.0, 2.0, 3.0]
    assert trials.z[:, 0, 0].tolist() == [1.0, 3.0, 4.0]
    assert trials.quantile(0.5) == 2.0


def test_measures_without_failures_keep_their_robustness(episode):
    trials = TrialMemory(HORIZON, 2, memory=3)
    trials.add([episode([(0, 0)], measures=Measures(7.5), outcome=Outcome.SAFE)])
    assert trials.robustness.tolist() == [7.5]


def test_the_replay_is_the_least_robust_share(episode):
    trials = TrialMemory(HORIZON, 2, memory=100)
    trials.add([episode(np.ones((6, 2)), r) for r in (3.0, 1.0, 2.0, 4.0, -1.0)])
    assert trials.select_replay(0.25).tolist() == [4, 1]
    assert trials.select_replay(0.0).tolist() == []


def test_a_kind_is_as_far_behind_as_its_best(episode):
    trials = TrialMemory(HORIZON, 2, memory=100)
    trials.add([episode(np.ones((6, 2)), r) for r in (3.0, 1.0, 2.5, 4.0)])
    assert trials.find_offsets(np.array([0, 0, 2, 2])).tolist() == [0.0, 0.0, 1.5, 1.5]
    assert trials.find_offsets(np.zeros(4, np.intp)).tolist() == [0.0] * 4
    trials.add([episode(np.ones((6, 2)), -2.0)])
    assert trials.find_offsets(np.array([0, 0, 2, 2, 1])).tolist() == [1.0, 1.0, 2.5, 2.5, 0.0]
