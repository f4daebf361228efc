"""Shapes: how the standardised noise u comes of z, independent and standard normal.

One frozen struct for each; TOML and JSON name it by its `kind`. Each says how u_t comes of z_t and
of u_{t-1} (`step`), the way back (`step_back`), and how steep it is (`log_slopes`). Every u_t has
mean 0 and variance 1, so that sigma means the same under every shape.
"""

from math import log, log1p, sqrt
from typing import Annotated

import msgspec
import numpy as np
from numpy.typing import NDArray

from eigenfail.values.disturbance import student_t

Pair = tuple[float, float]
Slopes = NDArray[np.float64]

Correlation = Annotated[float, msgspec.Meta(ge=0.0, lt=1.0)]


class White(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="white"):
    """The paper's noise: normal, and independent at every step. u = z."""

    def step(self, z: Pair, _before: Pair | None) -> Pair:
        """u_t of z_t."""
        return z

    def step_back(self, u: Pair, _before: Pair | None) -> Pair:
        """z_t of u_t."""
        return u

    def log_slopes(self, z: Slopes) -> Slopes:
        """log |du_t / dz_t|, shape (steps, 2)."""
        return np.zeros_like(z)

    def in_words(self) -> str:
        """What people read."""
        return "white: normal, independent at every step"


class Correlated(
    msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="ar1"
):
    """An autoregressive process of order one on each axis, stationary from its first step.

    u_0 = z_0, u_t = phi · u_{t-1} + sqrt(1 - phi²) · z_t (Box and Jenkins, Time Series Analysis,
    section 3.2), so that every u_t is standard normal and those k steps apart correlate by phi^k.

    Attributes:
        longitudinal_correlation: phi between one step and the next; lateral_correlation likewise.
    """

    longitudinal_correlation: Correlation = 0.8
    lateral_correlation: Correlation = 0.8

    def step(self, z: Pair, before: Pair | None) -> Pair:
        """u_t of z_t and u_{t-1}; None stands before the first step."""
        if before is None:
            return z
        (phi_x, phi_y), (new_x, new_y) = self._kept, self._new
        return phi_x * before[0] + new_x * z[0], phi_y * before[1] + new_y * z[1]

    def step_back(self, u: Pair, before: Pair | None) -> Pair:
        """z_t of u_t and u_{t-1}."""
        if before is None:
            return u
        (phi_x, phi_y), (new_x, new_y) = self._kept, self._new
        return (u[0] - phi_x * before[0]) / new_x, (u[1] - phi_y * before[1]) / new_y

    def log_slopes(self, z: Slopes) -> Slopes:
        """log |du_t / dz_t| = log sqrt(1 - phi²) after the first step, shape (steps, 2)."""
        slopes = np.zeros_like(z)
        slopes[1:] = [0.5 * log1p(-phi * phi) for phi in self._kept]
        return slopes

    @property
    def _kept(self) -> Pair:
        return self.longitudinal_correlation, self.lateral_correlation

    @property
    def _new(self) -> Pair:
        phi_x, phi_y = self._kept
        return sqrt((1.0 - phi_x) * (1.0 + phi_x)), sqrt((1.0 - phi_y) * (1.0 + phi_y))

    def in_words(self) -> str:
        """What people read."""
        phi_x, phi_y = self._kept
        by = f"{phi_x:g} (longitudinal) and {phi_y:g} (lateral)"
        return f"ar1: normal, correlated from step to step by {by}"


class HeavyTailed(
    msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="student_t"
):
    """Student's t in unit variance, independent at every step: outliers are part of the sensor.

    u = T⁻¹(Φ(z)) · sqrt((nu - 2) / nu), with T the distribution function for nu degrees of freedom
    (quantile transform: Devroye 1986, Non-Uniform Random Variate Generation, section II.2).

    Attributes:
        degrees_of_freedom: nu; the fewer, the heavier the tails. Kurtosis is finite above 4.
    """

    degrees_of_freedom: Annotated[float, msgspec.Meta(gt=2.0, le=1000.0)] = 5.0

    def step(self, z: Pair, _before: Pair | None) -> Pair:
        """u_t of z_t."""
        nu = self.degrees_of_freedom
        unit = self._unit
        return unit * student_t.of_normal(z[0], nu), unit * student_t.of_normal(z[1], nu)

    def step_back(self, u: Pair, _before: Pair | None) -> Pair:
        """z_t of u_t."""
        nu = self.degrees_of_freedom
        unit = self._unit
        return student_t.to_normal(u[0] / unit, nu), student_t.to_normal(u[1] / unit, nu)

    def log_slopes(self, z: Slopes) -> Slopes:
        """log |du_t / dz_t|, shape (steps, 2)."""
        slopes = [student_t.log_slope(each, self.degrees_of_freedom) for each in z.ravel().tolist()]
        return np.array(slopes).reshape(z.shape) + log(self._unit)

    @property
    def _unit(self) -> float:
        return sqrt((self.degrees_of_freedom - 2.0) / self.degrees_of_freedom)

    def in_words(self) -> str:
        """What people read."""
        nu = self.degrees_of_freedom
        return f"student_t: heavy tails of {nu:g} degrees of freedom, independent at every step"


Shape = White | Correlated | HeavyTailed
