"""How likely noise of the disturbance model is on average: what chosen noise is held against."""

from math import pi, sqrt

import numpy as np

from eigenfail.values import NoiseTrajectory

NODES, WEIGHTS = np.polynomial.hermite_e.hermegauss(40)
"""E[f(z)] of a standard normal z is sum(w · f(x)) / sqrt(2 pi) (Gauss and Hermite)."""


def expected_log_probability(noise: NoiseTrajectory) -> float:
    """E[log p(a_1 … a_T)] of a from p, over the same steps at the same sigma.

    log p differs from its value at z by no more than z²/2 and the slope of the shape at z_t, so
    that the expectation goes step by step: E[z²] = 1, and the slope by quadrature.
    """
    z = noise.z.astype(np.float64)
    slopes = (noise.shape.log_slopes(np.full_like(z, node)) for node in NODES)
    expected = sum(w * slope for w, slope in zip(WEIGHTS, slopes, strict=True)) / sqrt(2.0 * pi)
    known = 0.5 * z**2 + noise.shape.log_slopes(z)
    return float(noise.log_probability + np.sum(known - 0.5 - expected))
