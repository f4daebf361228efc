"""The sampler draws from the distribution whose velocity it is given."""

from math import erf, sqrt

import numpy as np
import pytest
import torch

from eigenfail_services.methods.difs.model import sample_ancestral

CENTRE, WIDTH = 2.0, 0.5
"""Two modes: x is N(±2, 0.5²), each with a chance of one half."""


def two_modes(x, angle):
    """E[v | x_t] in closed form: of each mode a linear function, weighted by what x_t tells."""
    cos, sin = torch.cos(angle)[:, None], torch.sin(angle)[:, None]
    variance = (cos * WIDTH) ** 2 + sin**2
    right = torch.sigmoid(2.0 * cos * CENTRE * x / variance)
    velocity = torch.zeros_like(x)
    for centre, share in ((CENTRE, right), (-CENTRE, 1.0 - right)):
        off = x - cos * centre
        x0 = centre + cos * WIDTH**2 / variance * off
        eps = sin / variance * off
        velocity = velocity + share * (cos * eps - sin * x0)
    return velocity


def truth(x):
    """The distribution function of the two modes."""
    return np.mean(
        [[0.5 + 0.5 * erf((v - c) / WIDTH / sqrt(2.0)) for v in x] for c in (-CENTRE, CENTRE)],
        axis=0,
    )


def error(steps):
    """The distance of Kolmogorov and Smirnov between samples and the two modes."""
    generator = torch.Generator().manual_seed(2)
    start = torch.randn(20_000, 1, generator=generator)
    x = np.sort(sample_ancestral(two_modes, start, steps, generator)[:, 0].numpy().astype(float))
    return np.abs(truth(x) - (np.arange(len(x)) + 0.5) / len(x)).max()


def test_two_modes_are_sampled_the_better_the_more_steps_there_are():
    assert error(4) > error(16) > error(200)
    assert error(25) < 0.06
    assert error(200) < 0.02


@pytest.mark.parametrize("steps", [1, 3, 20])
def test_a_moved_normal_is_sampled_exactly_in_any_number_of_ancestral_steps(steps):
    mean = torch.tensor([2.0, -1.0, 0.0])
    generator = torch.Generator().manual_seed(1)
    start = torch.randn(40_000, 3, generator=generator)
    samples = sample_ancestral(
        lambda x, angle: -torch.sin(angle)[:, None] * mean.expand_as(x), start, steps, generator
    )
    assert torch.allclose(samples.mean(dim=0), mean, atol=0.03)
    assert torch.allclose(torch.cov(samples.T), torch.eye(3), atol=0.04)
