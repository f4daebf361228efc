"""Problems with known answers: P(failure) under the prior, and the likeliest failure."""

from math import sqrt
from statistics import NormalDist

import numpy as np

from eigenfail.functions import of_batch

NORMAL = NormalDist()
SMALL_AST = {"hidden": (32, 32), "batch_size": 32, "warm_up": 30, "gradient_steps": 5}


def tail(beta):
    """Q(beta) = P(N(0, 1) >= beta)."""
    return NORMAL.cdf(-beta)


def unit(direction):
    """The direction in unit length."""
    return direction / np.linalg.norm(direction)


def steady(steps):
    """Longitudinal noise that stays, shape (steps, 2)."""
    return unit(np.stack([np.ones(steps), np.zeros(steps)], axis=1))


def turning(steps):
    """Lateral noise that grows while longitudinal noise of the other sign fades."""
    share = (np.arange(steps) + 0.5) / steps
    return unit(np.stack([share - 1.0, share], axis=1))


class HalfSpace:
    """r = beta - w·z with |w| = 1: P = Q(beta), and beta·w is the likeliest failure.

    Attributes:
        probability: of a failure.
        likeliest: the failure of the highest density, shape (steps, 2).
    """

    def __init__(self, probability, direction):
        self.steps = len(direction)
        self.direction = direction
        self.beta = -NORMAL.inv_cdf(probability)
        self.probability = probability
        self.likeliest = self.beta * direction
        self.function = of_batch(self.robustness)

    def robustness(self, z):
        return self.beta - np.sum(self.direction * z, axis=(1, 2))


class TwoModes:
    """r = max(3 - min(|x1|, x2), 0) of one step (Delecki et al. 2025): P = 2 Q(3)²."""

    steps = 1
    probability = 2.0 * tail(3.0) ** 2
    corners = np.array([[-3.0, 3.0], [3.0, 3.0]])

    def __init__(self):
        self.function = of_batch(self.robustness)

    def robustness(self, z):
        x1, x2 = z[:, 0, 0], z[:, 0, 1]
        return np.maximum(3.0 - np.minimum(np.abs(x1), x2), 0.0)


class PointMassCorridor:
    """A point mass that holds its lane by where it believes to be, between two walls.

    a_t = -k (y_t + s z_t) - c v_t, z_t lateral; robustness is what is left to the nearer wall, so
    that there is a mode on either side. y is linear in z, so that sigma_t = |dy_t / dz| is known:
    with beta = min_t wall / sigma_t, 2 Q(beta) <= P <= sum_t 2 Q(wall / sigma_t).
    """

    steps, dt_s = 24, 0.25
    k, c, s = 1.0, 0.6, 0.5

    def __init__(self, beta=4.0):
        self.gains = self._course(
            np.stack([np.zeros_like(np.eye(self.steps)), np.eye(self.steps)], axis=-1)
        ).T
        sigma = np.linalg.norm(self.gains, axis=1)
        last = int(np.argmax(sigma))
        self.wall = beta * sigma[last]
        self.at_least = 2.0 * tail(beta)
        self.at_most = sum(2.0 * tail(self.wall / each) for each in sigma if each)
        self.direction = np.zeros((self.steps, 2))
        self.direction[:, 1] = unit(self.gains[last])
        self.function = of_batch(self.robustness)

    def robustness(self, z):
        return self.wall - np.abs(self._course(z)).max(axis=1)

    def _course(self, z):
        """y after each step, shape (n, steps)."""
        y, v = np.zeros((2, len(z)))
        course = np.empty(z.shape[:2])
        for t in range(z.shape[1]):
            v = v + self.dt_s * (-self.k * (y + self.s * z[:, t, 1]) - self.c * v)
            y = y + self.dt_s * v
            course[:, t] = y
        return course


def cosine(a, b):
    """Of the angle between two noise trajectories."""
    return float(np.sum(a * b) / sqrt(np.sum(a * a) * np.sum(b * b)))
