"""Held noise: each value stays for the steps that the settings name, and has their scale."""

import numpy as np
import pytest

from eigenfail.values.learning import LearnerContext
from eigenfail_services.methods.held import HeldNoise

HORIZON = 100


def draw(episodes: int, seed: int = 1, channels: int = 2, **settings) -> np.ndarray:
    """Noise of some episodes, shape (episodes, steps, channels)."""
    nothing = np.zeros((0, HORIZON, channels), np.float32)
    context = LearnerContext(seed, episodes, HORIZON, nothing)
    learner = HeldNoise(context, HeldNoise.Settings(round_size=episodes, **settings))
    return np.stack([source.z for source in learner.propose(episodes).sources])


@pytest.mark.parametrize("hold", [1, 7, 10, 250])
def test_a_value_stays_for_as_long_as_the_setting_says(hold) -> None:
    for z in draw(40, hold=hold).transpose(0, 2, 1).reshape(-1, HORIZON):
        changes = np.flatnonzero(np.diff(z)) + 1
        assert len(changes) <= HORIZON // hold + 1
        assert set(np.diff(changes)) <= {hold}


@pytest.mark.parametrize("channels", [1, 2, 3, 5])
def test_values_are_normal_with_the_scale_of_the_settings(channels) -> None:
    values = draw(2000, channels=channels, hold=10, scale=1.5)[:, 50, :]
    assert values.shape == (2000, channels)
    assert np.allclose(values.mean(axis=0), 0.0, atol=4 * 1.5 / np.sqrt(2000))
    assert np.allclose(values.std(axis=0), 1.5, rtol=4 / np.sqrt(2 * 2000))
    correlation = np.atleast_2d(np.corrcoef(values.T))
    assert np.allclose(correlation, np.eye(channels), atol=4 / np.sqrt(2000))


@pytest.mark.parametrize("channels", [2, 5])
def test_a_value_may_change_at_any_step_and_the_channels_change_apart(channels) -> None:
    noise = draw(500, channels=channels, hold=10)
    changed = np.diff(noise, axis=1) != 0.0
    assert changed.any(axis=0).all()
    assert (changed[:, :, :-1] != changed[:, :, 1:]).any(axis=(0, 1)).all()


def test_the_noise_depends_on_the_seed_and_on_the_round_alone() -> None:
    assert np.array_equal(draw(5), draw(5))
    assert not np.array_equal(draw(5), draw(5, seed=2))
    nothing = np.zeros((0, HORIZON, 2), np.float32)
    learner = HeldNoise(LearnerContext(1, 10, HORIZON, nothing), HeldNoise.Settings(round_size=5))
    first, second = (np.stack([s.z for s in learner.propose(5).sources]) for _ in range(2))
    assert np.array_equal(first, draw(5))
    assert not np.array_equal(first, second)
