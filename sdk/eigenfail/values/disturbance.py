"""The disturbance model p(x) and what is drawn from it."""

from functools import cached_property
from math import log, pi
from typing import Annotated

import msgspec
import numpy as np
from numpy.typing import NDArray

from eigenfail.values.arrays import Floats

AXES = ("longitudinal", "lateral")

LOG_SQRT_TWO_PI = 0.5 * log(2.0 * pi)


class DisturbanceModel(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """a_t ~ N(0, diag(sigma_x², sigma_y²)), sigma growing with the distance (paper, eq. 2 and 3).

    sigma_x = longitudinal_slope · |dx| + longitudinal_base_m, and the same for y. [m]
    """

    longitudinal_slope: Annotated[float, msgspec.Meta(ge=0.0, le=1.0)] = 0.02
    longitudinal_base_m: Annotated[float, msgspec.Meta(gt=0.0, le=100.0)] = 1.0
    lateral_slope: Annotated[float, msgspec.Meta(ge=0.0, le=1.0)] = 0.00625
    lateral_base_m: Annotated[float, msgspec.Meta(gt=0.0, le=100.0)] = 0.2


class NoiseTrajectory(msgspec.Struct, frozen=True, eq=False, dict=True):
    """The disturbances of one episode, step by step, up to its end.

    Attributes:
        z: standardised noise z_t = a_t / sigma_t, shape (steps, 2): longitudinal, lateral. [sigma]
        sigma: standard deviations at each step, shape (steps, 2). [m]
    """

    z: Floats
    sigma: Floats

    @cached_property
    def metres(self) -> NDArray[np.float64]:
        """The disturbances a_t added to the perceived position, shape (steps, 2). [m]"""
        return self.z.astype(np.float64) * self.sigma

    @cached_property
    def log_probability(self) -> float:
        """log p(a_1 … a_T): the sum over the steps until the episode ended."""
        return float(np.sum(self.log_probability_per_step))

    @cached_property
    def log_probability_per_step(self) -> NDArray[np.float64]:
        """log p(a_t) of every step, shape (steps,)."""
        z, sigma = self.z.astype(np.float64), self.sigma.astype(np.float64)
        density: NDArray[np.float64] = -0.5 * z**2 - np.log(sigma) - LOG_SQRT_TWO_PI
        return density[:, 0] + density[:, 1]
