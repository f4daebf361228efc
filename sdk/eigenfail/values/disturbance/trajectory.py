"""The noise of one episode, and how likely it is."""

from collections.abc import Callable
from functools import cached_property
from math import log, pi

import msgspec
import numpy as np
from numpy.typing import NDArray

from eigenfail.values.arrays import Floats
from eigenfail.values.disturbance.conversion import Conversion
from eigenfail.values.disturbance.shapes import Pair, Shape, White
from eigenfail.values.showing import Brief, Tabular

AXES = ("longitudinal", "lateral")

LOG_SQRT_TWO_PI = 0.5 * log(2.0 * pi)

Doubles = NDArray[np.float64]


class NoiseTrajectory(Brief, Tabular, msgspec.Struct, frozen=True, eq=False, dict=True):
    """The disturbances of one episode, step by step, up to its end.

    Attributes:
        z: the standard normal draws behind the noise, shape (steps, 2): longitudinal, lateral.
        sigma: standard deviations at each step, shape (steps, 2). [m]
        shape: how the noise came of z.
    """

    z: Floats
    sigma: Floats
    shape: Shape = White()

    @classmethod
    def from_metres(cls, metres: Doubles, sigma: Floats, shape: Shape) -> "NoiseTrajectory":
        """The noise that injects these disturbances, shape (steps, 2), to float32's precision."""
        z = _converted(Conversion(shape).to_z, metres, sigma)
        return cls(z.astype(np.float32), sigma, shape)

    @cached_property
    def metres(self) -> Doubles:
        """The disturbances a_t added to the perceived position, shape (steps, 2). [m]"""
        return _converted(Conversion(self.shape).to_metres, self.z, self.sigma)

    @cached_property
    def standardised(self) -> Doubles:
        """u_t = a_t / sigma_t, of mean 0 and variance 1, shape (steps, 2). [sigma]"""
        return _converted(Conversion(self.shape).to_metres, self.z, np.ones_like(self.z))

    @cached_property
    def log_probability(self) -> float:
        """log p(a_1 … a_T): the sum over the steps until the episode ended."""
        return float(np.sum(self.log_probability_per_step))

    @cached_property
    def log_probability_per_step(self) -> Doubles:
        """log p(a_t | a_1 … a_{t-1}) of every step, shape (steps,); a in metres.

        On each axis log N(z_t) - log sigma_t - log |du_t/dz_t|: a change of variables whose
        Jacobian is triangular, since u_t depends on no later z.
        """
        z, sigma = self.z.astype(np.float64), self.sigma.astype(np.float64)
        density: Doubles = -0.5 * z**2 - np.log(sigma) - LOG_SQRT_TWO_PI
        density -= self.shape.log_slopes(z)
        return density[:, 0] + density[:, 1]


def _converted(
    step: Callable[[Pair, Pair], Pair], values: NDArray[np.floating], sigma: Floats
) -> Doubles:
    """Every row of an array with its sigma taken through one step of a conversion."""
    rows = zip(values.tolist(), sigma.tolist(), strict=True)
    return np.array([step(value, at) for value, at in rows]).reshape(-1, 2)
