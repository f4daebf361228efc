"""Failure problems of known probability: several regions, curved borders, 1 to 200 dimensions.

Where there is no closed form, the probability is that of a brute force, with its number of draws.
"""

from collections.abc import Callable
from math import sqrt
from statistics import NormalDist

import msgspec
import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

Noise = NDArray[np.float64]
NORMAL = NormalDist()


class Problem(msgspec.Struct, frozen=True):
    """Robustness as a function of noise, shape (n, steps, 2), with a known P(robustness <= 0)."""

    name: str
    steps: int
    probability: float
    robustness: Callable[[Noise], Noise]


def _flatten(z: Noise) -> Noise:
    return z.reshape(len(z), -1)


def _project(z: Noise) -> Noise:
    """Return the projection on the diagonal, a standard normal number, shape (n,)."""
    return _flatten(z).sum(axis=1) / sqrt(z[0].size)


def half_space(probability: float, steps: int = 5) -> Problem:
    """Beyond a plane."""
    reach = -NORMAL.inv_cdf(probability)
    name = f"half space {probability:.0e}, d = {2 * steps}"
    return Problem(name, steps, probability, lambda z: reach - _project(z))


def one_axis(probability: float) -> Problem:
    """Beyond a bound of one number; the other one has no effect."""
    reach = -NORMAL.inv_cdf(probability)
    return Problem(f"one axis {probability:.0e}", 1, probability, lambda z: reach - z[:, 0, 0])


def two_sided(probability: float, steps: int = 5) -> Problem:
    """Beyond either of two planes, on opposite sides of the origin."""
    reach = -NORMAL.inv_cdf(probability / 2.0)
    name = f"two sides {probability:.0e}, d = {2 * steps}"
    return Problem(name, steps, probability, lambda z: reach - np.abs(_project(z)))


def two_half_spaces(probability: float, other: float) -> Problem:
    """Beyond either of two planes with different probabilities."""
    reach, behind = (-NORMAL.inv_cdf(each) for each in (probability, other))

    def robustness(z: Noise) -> Noise:
        along = _project(z)
        return np.minimum(reach - along, behind + along)

    truth = probability + other
    return Problem(f"two regions {probability:.0e} + {other:.0e}", 5, truth, robustness)


def four_half_spaces(probability: float) -> Problem:
    """Beyond any of four planes at right angles, each with the same probability."""
    reach = -NORMAL.inv_cdf(probability)

    def robustness(z: Noise) -> Noise:
        sums = z.sum(axis=1) / sqrt(z.shape[1])
        return reach - np.abs(sums).max(axis=1)

    # The two axes are independent, so that exactly the corners would be counted twice.
    truth = 1.0 - (1.0 - 2.0 * probability) ** 2
    return Problem(f"four regions {probability:.0e} each", 5, truth, robustness)


def two_modes() -> Problem:
    """max(3 − min(|x1|, x2), 0): two corners, P = 2·Q(3)²."""
    return Problem(
        "two corners 4e-06",
        1,
        2.0 * NORMAL.cdf(-3.0) ** 2,
        lambda z: np.maximum(3.0 - np.minimum(np.abs(z[:, 0, 0]), z[:, 0, 1]), 0.0),
    )


def four_branches() -> Problem:
    """The series system of four branches with k = 7; P by 40,000,000 draws."""

    def robustness(z: Noise) -> Noise:
        a, b = z[:, 0, 0], z[:, 0, 1]
        curved, plane = 3.0 + 0.1 * (a - b) ** 2, 7.0 / sqrt(2.0)
        along = (a + b) / sqrt(2.0)
        return np.minimum.reduce([curved - along, curved + along, a - b + plane, b - a + plane])

    return Problem("four branches", 1, 2.228e-3, robustness)


def rp22() -> Problem:
    """Problem 22 of the black-box reliability challenge: a curved border; P by 40,000,000 draws."""

    def robustness(z: Noise) -> Noise:
        a, b = z[:, 0, 0], z[:, 0, 1]
        return 2.5 - (a + b) / sqrt(2.0) + 0.1 * (a - b) ** 2

    return Problem("RP22", 1, 4.216e-3, robustness)


def banana() -> Problem:
    """A bent region on both sides of an axis; P by 40,000,000 draws."""
    return Problem(
        "banana", 1, 1.054e-3, lambda z: 4.2 - z[:, 0, 0] - 0.35 * (z[:, 0, 1] ** 2 - 1.0)
    )


def shell() -> Problem:
    """Outside a sphere in six dimensions: failures in every direction."""
    probability = 1e-4
    radius = float(np.sqrt(chi2.isf(probability, 6)))
    return Problem(
        "shell 1e-04, d = 6", 3, probability, lambda z: radius - np.linalg.norm(_flatten(z), axis=1)
    )


def walk() -> Problem:
    """A random walk of 60 numbers that leaves a band on either side; P by 4,000,000 draws."""
    return Problem(
        "random walk, d = 60",
        30,
        5.06e-4,
        lambda z: 3.6 - np.abs(np.cumsum(_flatten(z), axis=1)).max(axis=1) / sqrt(60.0),
    )


def braking() -> Problem:
    """A leaky sum of the longitudinal noise, without steps of large lateral noise: as a tracker
    that loses its measurements; P by 4,000,000 draws."""

    def robustness(z: Noise) -> Noise:
        error, largest = np.zeros(len(z)), np.zeros(len(z))
        for step in range(z.shape[1]):
            error = 0.9 * error + z[:, step, 0] * (np.abs(z[:, step, 1]) < 2.0)
            largest = np.maximum(largest, error)
        return 9.0 - largest

    return Problem("braking, d = 60", 30, 3.58e-4, robustness)


PROBLEMS = (
    *(half_space(p) for p in (1e-3, 1e-4, 1e-5, 1e-6)),
    one_axis(1e-4),
    half_space(1e-4, steps=20),
    half_space(1e-4, steps=100),
    two_sided(1e-4),
    two_half_spaces(1e-3, 1e-3),
    two_half_spaces(1e-5, 1e-5),
    two_half_spaces(1e-3, 1e-4),
    four_half_spaces(1e-3),
    two_modes(),
    four_branches(),
    rp22(),
    banana(),
    shell(),
    walk(),
    braking(),
)
