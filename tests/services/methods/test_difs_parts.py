"""The diffusion process against closed forms, and what the model is trained on."""

from math import pi

import numpy as np
import pytest
import torch

from eigenfail.values import Measures, Outcome
from eigenfail_services.methods.difs import diffusion
from eigenfail_services.methods.difs.model import DiffusionModel
from eigenfail_services.methods.difs.options import DiffusionOptions, Examples
from eigenfail_services.methods.difs.trials import FLOOR, SOFTNESS, Trials

HORIZON = 6


def model(**changes):
    given = {
        "horizon": HORIZON,
        "width": 16,
        "learning_rate": 3e-3,
        "weight_decay": 0.0,
        "batch_size": 64,
        "ema": 0.98,
        "dropout": 0.1,
        "sampling_steps": 20,
        "shrink": 1.0,
        "device": "cpu",
        "seed": 0,
    }
    return DiffusionModel(DiffusionOptions(**{**given, **changes}))


def test_velocity_and_noised_data_are_a_rotation():
    x0, eps = torch.randn(2, 5, 3, generator=torch.Generator().manual_seed(0))
    angle = torch.linspace(0.0, pi / 2, 5)
    x, v = diffusion.diffuse(x0, eps, angle), diffusion.velocity(x0, eps, angle)
    torch.testing.assert_close(torch.cos(angle)[:, None] * x - torch.sin(angle)[:, None] * v, x0)
    torch.testing.assert_close(torch.sin(angle)[:, None] * x + torch.cos(angle)[:, None] * v, eps)


@pytest.mark.parametrize("steps", [1, 3, 20])
def test_a_moved_normal_is_sampled_exactly_in_any_number_of_steps(steps):
    mean = torch.tensor([2.0, -1.0, 0.0])
    generator = torch.Generator().manual_seed(1)
    start = torch.randn(40_000, 3, generator=generator)
    samples = diffusion.sample(
        lambda x, angle: -torch.sin(angle)[:, None] * mean.expand_as(x), start, steps, generator
    )
    assert torch.allclose(samples.mean(dim=0), mean, atol=0.03)
    assert torch.allclose(torch.cov(samples.T), torch.eye(3), atol=0.04)


def test_data_of_another_variance_is_approached_as_the_steps_grow():
    variance = 0.25
    generator = torch.Generator().manual_seed(2)

    def velocity(x, angle):
        cos, sin = torch.cos(angle)[:, None], torch.sin(angle)[:, None]
        # E[v | x_t] for x_0 ~ N(0, variance): a linear function of x_t.
        return cos * sin * (1.0 - variance) / (cos**2 * variance + sin**2) * x

    errors = []
    for steps in (5, 20, 80):
        start = torch.randn(40_000, 1, generator=generator)
        errors.append(abs(float(diffusion.sample(velocity, start, steps, generator).var()) - 0.25))
    assert errors[0] > errors[1] > errors[2]
    assert errors[2] < 0.03


def test_the_untrained_model_samples_the_prior():
    z = model().sample(np.full(4000, 0.3, np.float32), guidance=2.0, draw=1)
    assert z.shape == (4000, HORIZON, 2)
    assert z.dtype == np.float32
    flat = z.reshape(len(z), -1)
    assert np.abs(flat.mean(axis=0)).max() < 0.07
    assert np.abs(np.cov(flat.T) - np.eye(2 * HORIZON)).max() < 0.09


def test_learns_how_the_mean_depends_on_the_condition_and_fills_unseen_steps_from_the_prior():
    random = np.random.default_rng(0)
    condition = random.uniform(0.0, 1.0, 2000).astype(np.float32)
    z = random.standard_normal((2000, HORIZON, 2)).astype(np.float32)
    z[:, :3, 0] += 2.0 * (1.0 - condition)[:, None]
    unseen = np.zeros_like(z)
    unseen[:, 4:] = 1.0
    z[:, 4:] = 0.0
    learner = model(dropout=0.0, learning_rate=1e-2)
    flat = Examples(z.reshape(2000, -1), unseen.reshape(2000, -1), condition, np.ones(2000))
    learner.train(flat, steps=600, draw=1)
    dangerous = learner.sample(np.zeros(2000, np.float32), guidance=0.0, draw=2)
    harmless = learner.sample(np.ones(2000, np.float32), guidance=0.0, draw=2)
    assert dangerous[:, :3, 0].mean() == pytest.approx(2.0, abs=0.3)
    assert harmless[:, :3, 0].mean() == pytest.approx(0.0, abs=0.3)
    for part in (dangerous[:, 4:], dangerous[:, :4, 1]):
        assert abs(part.mean()) < 0.15
        assert part.std() == pytest.approx(1.0, abs=0.1)


def test_weights_fall_above_the_threshold_and_never_vanish(episode):
    trials = Trials(HORIZON, memory=100)
    trials.add([episode([(0, 0)], r) for r in (0.5, 1.0, 1.0 + 2.0 * SOFTNESS, 500.0)])
    np.testing.assert_allclose(
        trials.weights(threshold_m=1.0, scale_m=2.0),
        [1.0 + FLOOR, 1.0 + FLOOR, np.exp(-1.0) + FLOOR, FLOOR],
        rtol=1e-6,
    )


def test_steps_behind_an_episodes_end_are_unseen(episode):
    trials = Trials(4, memory=100)
    trials.add([episode(np.ones((2, 2))), episode(np.ones((4, 2)), 3.0)])
    np.testing.assert_array_equal(trials.unseen()[..., 0], [[0, 0, 1, 1], [0, 0, 0, 0]])
    np.testing.assert_array_equal(trials.z[:, :, 0], [[1, 1, 0, 0], [1, 1, 1, 1]])


def test_failed_episodes_are_not_remembered_and_the_safest_make_room(episode):
    trials = Trials(HORIZON, memory=3)
    robustness = [5.0, 1.0, 4.0, 2.0, 3.0]
    trials.add([episode([(i, 0)], r) for i, r in enumerate(robustness)])
    trials.add([episode([(9, 0)], 0.5, outcome=Outcome.FAILED), episode([], 0.1, measures=None)])
    assert trials.robustness.tolist() == [1.0, 2.0, 3.0]
    assert trials.z[:, 0, 0].tolist() == [1.0, 3.0, 4.0]
    assert trials.quantile(0.5) == 2.0


def test_measures_without_failures_keep_their_robustness(episode):
    trials = Trials(HORIZON, memory=3)
    trials.add([episode([(0, 0)], measures=Measures(7.5), outcome=Outcome.SAFE)])
    assert trials.robustness.tolist() == [7.5]
