"""Noise with a shape and without: what a tester gets from no learning at all."""

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

HALF_PERIODS = range(8, 21)
AXES = ((1.0, 0.0), (0.0, 1.0), (1.0, 1.0))


def draw_held_noise(rng: np.random.Generator, n: int, steps: int, sigma: float, hold: int) -> Array:
    """Uniform in ±sigma, each value held for some steps; shape (n, steps, 2)."""
    drawn = rng.uniform(-sigma, sigma, (n, -(-steps // hold), 2))
    return np.repeat(drawn, hold, axis=1)[:, :steps]


def square_wave(steps: int, sigma: float, half_period: int) -> Array:
    """A longitudinal wave of ±sigma that begins high; shape (steps, 2)."""
    high = np.arange(steps) // half_period % 2 == 0
    return np.where(high, sigma, -sigma)[:, None] * (1.0, 0.0)


def square_waves(steps: int, sigma: float) -> Array:
    """Longitudinal, lateral and both at once, beginning high and low, of each half-period."""
    courses = [square_wave(steps, sigma, half_period)[:, :1] for half_period in HALF_PERIODS]
    signed = [sign * course for course in courses for sign in (1.0, -1.0)]
    return np.array([course * axes for axes in AXES for course in signed])


def shuffles(rng: np.random.Generator, z: Array, n: int) -> Array:
    """One trajectory, its steps in n random orders; shape (n, steps, 2)."""
    return np.array([rng.permutation(z) for _ in range(n)])
