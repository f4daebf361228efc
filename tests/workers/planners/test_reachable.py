"""The failures that methods are to find can be reached: by the shape of noise, not by its values.

The waves are drawn by hand: no method had a part in them.
"""

import numpy as np
import pytest

STEPS = 100
SHUFFLES, ORDINARY = 20, 40


def slow_wave(sigma, half_period):
    """Longitudinal noise that stands at +sigma, then at −sigma; shape (steps, 2)."""
    high = np.arange(STEPS) // half_period % 2 == 0
    return np.where(high, sigma, -sigma)[:, None] * (1.0, 0.0)


@pytest.fixture
def crashing_wave(drive):
    """The weakest of a few slow waves within ±3 sigma that makes the planner collide."""
    waves = [slow_wave(sigma, half) for sigma in (2.0, 2.5, 3.0) for half in (16, 18, 20, 22)]
    crashing = [z for z in waves if drive(z).is_failure]
    assert crashing, "no slow wave within ±3 sigma makes it collide"
    return crashing[0]


def crashes(drive, trajectories):
    return sum(drive(z).is_failure for z in trajectories)


def test_a_slow_wave_of_ordinary_values_makes_it_collide_hard(drive, crashing_wave):
    result = drive(crashing_wave)
    assert np.abs(result.noise.z).max() <= 3.0
    assert result.measures.severity > 30.0


def test_the_same_values_shuffled_in_time_seldom_do(drive, crashing_wave):
    rng = np.random.default_rng(3)
    shuffled = [rng.permutation(crashing_wave) for _ in range(SHUFFLES)]
    assert crashes(drive, shuffled) <= SHUFFLES // 4


def test_ordinary_white_noise_does_not(drive):
    rng = np.random.default_rng(4)
    assert crashes(drive, rng.normal(size=(ORDINARY, STEPS, 2))) == 0
