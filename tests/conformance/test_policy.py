"""A policy acts in the workers' numpy as it does in the learner's torch."""

import numpy as np
import torch

from eigenfail.values.learning import STATE
from eigenfail_services.methods.ast.settings import AstSettings
from eigenfail_services.methods.ast.trainer_numpy import FastTrainer
from eigenfail_services.methods.ast.trainer_sb3 import SacTrainer
from eigenfail_workers.noise.policy import act, copy_policy, validate_policy

SEED = 7


SETTINGS = AstSettings(
    learning_rate=3e-4,
    batch_size=16,
    buffer_size=100,
    tau=0.001,
    gamma=0.99,
    hidden=(64, 32),
    entropy=1.0,
    target_entropy=-2.0,
    amplitude=2.5,
    hold=5,
    n_step=1,
)


def trainer():
    made = SacTrainer(SETTINGS, 2, SEED)
    # Far from the tame start: saturated actions and clamped deviations shall agree too.
    with torch.no_grad():
        made._model.actor.mu.weight.mul_(10.0)
        made._model.actor.log_std.weight.mul_(40.0)
    return made


def test_numpy_and_torch_choose_the_same_noise():
    made = trainer()
    policy = copy_policy(made.policy(version=3))
    validate_policy(policy)
    random = np.random.default_rng(SEED)
    states = random.normal(size=(500, len(STATE))).astype(np.float32) * 2.0
    eps = random.standard_normal((500, 2), np.float32)
    with torch.no_grad():
        mean, log_std, _ = made._model.actor.get_action_dist_params(torch.from_numpy(states))
        expected = 2.5 * torch.tanh(mean + torch.exp(log_std) * torch.from_numpy(eps))
    chosen = np.array([act(policy, s, e) for s, e in zip(states, eps, strict=True)])
    assert {-20.0, 2.0} <= set(log_std.flatten().tolist())
    assert np.abs(chosen).max() <= 2.5
    np.testing.assert_allclose(chosen, expected.numpy(), rtol=0.0, atol=2e-5)


def test_the_trainer_means_the_policy_that_it_exports():
    made = FastTrainer(SETTINGS, 2, SEED)
    made.actor.weights *= 8.0
    policy = copy_policy(made.policy(version=0))
    validate_policy(policy)
    random = np.random.default_rng(SEED)
    states = random.normal(size=(500, len(STATE))).astype(np.float32) * 2.0
    eps = random.standard_normal((500, 2), np.float32)
    expected = 2.5 * made._choose(states, eps).actions
    chosen = np.array([act(policy, s, e) for s, e in zip(states, eps, strict=True)])
    np.testing.assert_allclose(chosen, expected, rtol=0.0, atol=2e-4)


def test_an_exported_policy_stays_as_it_was_when_training_goes_on():
    made = trainer()
    policy = made.policy(version=0)
    before = policy.mean.weight.copy()
    with torch.no_grad():
        made._model.actor.mu.weight.add_(1.0)
    np.testing.assert_array_equal(policy.mean.weight, before)
