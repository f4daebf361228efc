"""How likely noise of the disturbance model is on average: what chosen noise is held against."""

from functools import lru_cache
from math import pi, sqrt

import numpy as np
from numpy.typing import NDArray

from eigenfail.values import NoiseTrajectory
from eigenfail.values.disturbance import Shape

NODES, WEIGHTS = np.polynomial.hermite_e.hermegauss(40)
"""E[f(z)] of a standard normal z is sum(w · f(x)) / sqrt(2 pi) (Gauss and Hermite)."""


def expected_log_probability(noise: NoiseTrajectory) -> float:
    """E[log p(a_1 … a_T)] of a from p, over the same steps at the same sigma.

    log p differs from its value at z by no more than z²/2 and the slope of the shape at z_t, so
    that the expectation goes step by step: E[z²] = 1, and the slope by quadrature.
    """
    z = noise.z.astype(np.float64)
    expected = expected_slopes(noise.shape)[np.minimum(np.arange(len(z)), 1)]
    known = 0.5 * z**2 + noise.shape.log_slopes(z)
    return float(noise.log_probability + np.sum(known - 0.5 - expected))


@lru_cache(maxsize=256)
def expected_slopes(shape: Shape) -> NDArray[np.float64]:
    """E[log |du_t / dz_t|] at the first step and at any later one, shape (2, 2)."""
    slopes = [shape.log_slopes(np.full((2, 2), node)) for node in NODES]
    expected: NDArray[np.float64] = np.tensordot(WEIGHTS, slopes, 1) / sqrt(2.0 * pi)
    expected.setflags(write=False)
    return expected
