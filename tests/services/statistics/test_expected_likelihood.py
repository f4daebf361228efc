"""The likelihood that noise has on average, against quadrature step by step; and what it costs."""

from math import pi, sqrt

import numpy as np
import pytest

from eigenfail.values import student_t
from eigenfail.values.disturbance import NoiseTrajectory
from eigenfail.values.shapes import (
    Autoregressive,
    Correlated,
    HeavyTailed,
    Markov,
    PerChannel,
    White,
)
from eigenfail_services.statistics.importance import (
    NODES,
    WEIGHTS,
    expected_log_probability,
)

STEPS = 30
AR1 = Correlated(longitudinal_correlation=0.9, lateral_correlation=0.3)


def noise_of(shape, channels=2):
    rng = np.random.default_rng(3)
    z = rng.normal(size=(STEPS, channels)).astype(np.float32)
    return NoiseTrajectory(z, np.full(z.shape, 0.5, np.float32), shape)


T = HeavyTailed(degrees_of_freedom=4.5)


@pytest.mark.parametrize(
    ("shape", "channels"),
    [(White(), 2), (AR1, 2), (T, 2), *((each, d) for each in (White(), T) for d in (1, 3, 5))],
)
def test_it_is_the_mean_over_the_nodes_of_noise_that_is_the_same_at_every_step(shape, channels):
    noise = noise_of(shape, channels)
    at_nodes = [
        NoiseTrajectory(np.full_like(noise.z, node), noise.sigma, shape).log_probability
        for node in NODES
    ]
    expected = float(np.dot(WEIGHTS, at_nodes)) / sqrt(2.0 * pi)
    assert expected_log_probability(noise) == pytest.approx(expected, rel=1e-6)


def test_heavy_tails_are_not_integrated_at_every_step(monkeypatch):
    looked, log_slope = [], student_t.log_t_slope
    monkeypatch.setattr(
        student_t, "log_t_slope", lambda z, nu: looked.append(z) or log_slope(z, nu)
    )
    noise = noise_of(HeavyTailed(degrees_of_freedom=5.25))
    expected_log_probability(noise)
    first = len(looked)
    expected_log_probability(noise)
    # Once for what the noise has, once for what is known of its shape: never once for each node.
    assert len(looked) - first <= 4 * STEPS < first <= 4 * STEPS + 4 * len(NODES)


EVEN = np.ones((STEPS, 2), np.float32)
FALLING = np.stack([np.ones(STEPS), np.linspace(0.4, 0.01, STEPS)], axis=1).astype(np.float32)
"""What the rate of events in each step follows."""


@pytest.mark.parametrize(
    ("shapes", "sigma"),
    [
        *(
            ((chain, Autoregressive(0.7)), EVEN)
            for chain in (Markov(0.05, 4.0), Markov(0.5, 1.0), Markov(0.002, 50.0))
        ),
        ((White(), Markov(0.01, 4.0, 0.001)), FALLING),
    ],
    ids=["usual", "frequent", "rare", "rate of each step"],
)
def test_of_events_it_is_the_mean_over_many_draws(shapes, sigma):
    shape, rng = PerChannel(shapes), np.random.default_rng(5)
    drawn = [
        NoiseTrajectory(rng.normal(size=(STEPS, 2)).astype(np.float32), sigma, shape)
        for _ in range(1_500)
    ]
    found = [noise.log_probability for noise in drawn]
    error = np.std(found) / np.sqrt(len(found))
    assert expected_log_probability(drawn[0]) == pytest.approx(np.mean(found), abs=4.0 * error)
    assert len({round(expected_log_probability(each), 6) for each in drawn[:5]}) == 1
    assert expected_log_probability(NoiseTrajectory(sigma[:0], sigma[:0], shape)) == 0.0
