"""The disturbance model p(x): shapes of the noise, conversion to metres, and noise trajectories."""

from collections.abc import Callable, Sequence
from functools import cached_property, lru_cache
from itertools import accumulate
from math import copysign, erf, erfc, exp, lgamma, log, log1p, pi, sqrt
from statistics import NormalDist
from typing import Annotated

import msgspec
import numpy as np
from numpy.typing import NDArray

from eigenfail.values.arrays import Floats
from eigenfail.values.showing import Brief, Tabular

# Student's t and the standard normal, quantile to quantile, accurate far into both tails: t(z)
# solves T(t) = Phi(z), where T is the distribution function of Student's t with nu degrees of
# freedom. Beyond |z| = REACH, which one draw in 1e57 exceeds, t keeps its value at REACH.

REACH = 16.0
KNOTS_PER_SIGMA = 64
FRACTION_TERMS = 60
FAR = 1e150
"""Beyond it the square of t would overflow."""

SQRT_TWO = sqrt(2.0)
LOG_SQRT_TWO_PI = 0.5 * log(2.0 * pi)
LEAST_TAIL = 0.5 * erfc(REACH / SQRT_TWO)
NORMAL = NormalDist()


def map_normal_to_t(z: float, nu: float) -> float:
    """Return t(z), to about ten digits; NaN counts as REACH."""
    size = min(REACH, abs(z))
    return copysign(size * exp(_log_stretch(nu)(size)), z)


def map_t_to_normal(t: float, nu: float) -> float:
    """z with t(z) = t."""
    _, tails = split_t_mass(min(FAR, abs(t)), nu)
    return copysign(NORMAL.inv_cdf(max(0.5 * tails, LEAST_TAIL)), t)


def log_t_slope(z: float, nu: float) -> float:
    """log dt/dz = log φ(z) - log f(t), by differentiating T(t) = Φ(z)."""
    size = min(REACH, abs(z))
    return -0.5 * size * size - LOG_SQRT_TWO_PI - log_t_density(map_normal_to_t(size, nu), nu)


def log_t_density(t: float, nu: float) -> float:
    """log f(t) (Abramowitz and Stegun, 26.7.1)."""
    norm = lgamma(0.5 * (nu + 1.0)) - lgamma(0.5 * nu) - 0.5 * log(nu * pi)
    return norm - 0.5 * (nu + 1.0) * log1p(t * t / nu)


def split_t_mass(t: float, nu: float) -> tuple[float, float]:
    """P(|T| < t) and P(|T| > t) for t ≥ 0, the smaller of them to nearly all of its digits.

    They are I_x(1/2, nu/2) and I_{1-x}(nu/2, 1/2) with x = t² / (nu + t²) (DLMF 8.17; Abramowitz
    and Stegun, 26.7.1); of the two, that is computed whose continued fraction converges fast.
    """
    x, rest = t * t / (nu + t * t), nu / (nu + t * t)
    if x < 3.0 / (5.0 + nu):
        inside = _incomplete_beta(0.5, 0.5 * nu, x, rest)
        return inside, 1.0 - inside
    outside = _incomplete_beta(0.5 * nu, 0.5, rest, x)
    return 1.0 - outside, outside


def _incomplete_beta(a: float, b: float, x: float, rest: float) -> float:
    """I_x(a, b), given rest = 1 - x as well (DLMF 8.17.22); for x up to (a + 1) / (a + b + 2)."""
    fraction = 1.0
    for m in range(FRACTION_TERMS, 0, -1):
        even = m * (b - m) * x / ((a + 2 * m - 1) * (a + 2 * m))
        odd = -(a + m) * (a + b + m) * x / ((a + 2 * m) * (a + 2 * m + 1))
        fraction = 1.0 + even / (1.0 + odd / fraction)
    fraction = 1.0 - (a + b) * x / (a + 1.0) / fraction
    beta = exp(lgamma(a) + lgamma(b) - lgamma(a + b))
    power: float = x**a * rest**b
    return power / (a * beta * fraction)


class LogStretch:
    """log(t(z) / z) for 0 ≤ z ≤ REACH: found at knots, between them by cubic Hermite polynomials.

    An inversion costs a hundred times as much as a look into this table. The function is smooth
    and nearly a parabola; at 64 knots a sigma the error stays below 1e-9.
    """

    def __init__(self, nu: float) -> None:
        self._nu = nu
        # At z = 0, t/z is the ratio of the two densities there.
        self._values = [-LOG_SQRT_TWO_PI - log_t_density(0.0, nu)]
        self._slopes = [0.0]
        for knot in range(1, int(REACH * KNOTS_PER_SIGMA) + 1):
            self._append(knot / KNOTS_PER_SIGMA)

    def _append(self, z: float) -> None:
        guess = self._values[-1] + self._slopes[-1] / KNOTS_PER_SIGMA
        log_t = _log_t(z, self._nu, log(z) + guess)
        steepness = -0.5 * z * z - LOG_SQRT_TWO_PI - log_t_density(exp(log_t), self._nu) - log_t
        self._values.append(log_t - log(z))
        self._slopes.append(exp(steepness) - 1.0 / z)

    def __call__(self, z: float) -> float:
        """The value at z."""
        at = z * KNOTS_PER_SIGMA
        knot = min(int(at), len(self._values) - 2)
        s = at - knot
        left, right = self._values[knot], self._values[knot + 1]
        out, into = (slope / KNOTS_PER_SIGMA for slope in self._slopes[knot : knot + 2])
        rise = right - left
        return left + s * (out + s * (3 * rise - 2 * out - into + s * (out + into - 2 * rise)))


def _log_t(z: float, nu: float, guess: float) -> float:
    """log t with T(t) = Φ(z), z > 0: Newton's method on the logarithm of the smaller mass."""
    central = z < 1.0
    target = log(erf(z / SQRT_TWO) if central else erfc(z / SQRT_TWO))
    log_t = guess
    for _ in range(4):
        inside, outside = split_t_mass(exp(log_t), nu)
        mass = inside if central else -outside
        slope = 2.0 * exp(log_t_density(exp(log_t), nu) + log_t) / mass
        log_t -= (log(abs(mass)) - target) / slope
    return log_t


_log_stretch = lru_cache(maxsize=16)(LogStretch)


# Shapes: how the standardised noise u follows from z, which is independent and standard normal.
# Each is a frozen struct that TOML and JSON name by its `kind`, and gives u_t from z_t and u_{t-1}
# (`step`), the inverse (`step_back`), and the slope (`log_slopes`). Every u_t has mean 0 and
# variance 1, so that sigma means the same under every shape.

Pair = tuple[float, float]
"""A longitudinal and a lateral value."""

Row = tuple[float, ...]
"""A value for each channel, at one step."""

Slopes = NDArray[np.float64]

Correlation = Annotated[float, msgspec.Meta(ge=0.0, lt=1.0)]


class White(msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="white"):
    """The paper's noise: normal, and independent at every step. u = z."""

    def step(self, z: Row, _before: Row | None) -> Row:
        """u_t of z_t."""
        return z

    def step_back(self, u: Row, _before: Row | None) -> Row:
        """z_t of u_t."""
        return u

    def log_slopes(self, z: Slopes) -> Slopes:
        """log |du_t / dz_t|, shape (steps, channels)."""
        return np.zeros(z.shape)

    def in_words(self) -> str:
        """What people read."""
        return "white: normal, independent at every step"


class Correlated(
    msgspec.Struct, frozen=True, forbid_unknown_fields=True, tag_field="kind", tag="ar1"
):
    """An autoregressive process of order one on each of two axes, stationary from its first step.

    u_0 = z_0, u_t = phi · u_{t-1} + sqrt(1 - phi²) · z_t (Box and Jenkins, Time Series Analysis,
    section 3.2), so that every u_t is standard normal and those k steps apart correlate by phi^k.

    Attributes:
        longitudinal_correlation: phi between one step and the next; lateral_correlation likewise.
    """

    longitudinal_correlation: Correlation = 0.8
    lateral_correlation: Correlation = 0.8

    def step(self, z: Row, before: Row | None) -> Row:
        """u_t of z_t and u_{t-1}; None stands before the first step."""
        if before is None:
            return z
        (phi_x, phi_y), (new_x, new_y) = self._kept, self._new
        return phi_x * before[0] + new_x * z[0], phi_y * before[1] + new_y * z[1]

    def step_back(self, u: Row, before: Row | None) -> Row:
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

    def step(self, z: Row, _before: Row | None) -> Row:
        """u_t of z_t."""
        nu, unit = self.degrees_of_freedom, self._unit
        return tuple([unit * map_normal_to_t(each, nu) for each in z])

    def step_back(self, u: Row, _before: Row | None) -> Row:
        """z_t of u_t."""
        nu, unit = self.degrees_of_freedom, self._unit
        return tuple([map_t_to_normal(each / unit, nu) for each in u])

    def log_slopes(self, z: Slopes) -> Slopes:
        """log |du_t / dz_t|, shape (steps, channels)."""
        slopes = [log_t_slope(each, self.degrees_of_freedom) for each in z.ravel().tolist()]
        return np.array(slopes).reshape(z.shape) + log(self._unit)

    @property
    def _unit(self) -> float:
        return sqrt((self.degrees_of_freedom - 2.0) / self.degrees_of_freedom)

    def in_words(self) -> str:
        """What people read."""
        nu = self.degrees_of_freedom
        return f"student_t: heavy tails of {nu:g} degrees of freedom, independent at every step"


Shape = White | Correlated | HeavyTailed


class DisturbanceModel(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """a_t = sigma_t · u_t, sigma growing with the distance (paper, eq. 2 and 3).

    sigma_x = scale · (longitudinal_slope · |dx| + longitudinal_base_m), and the same for y. [m]
    u = shape(z), with z independent and standard normal; with the default shape, u = z: the
    paper's a_t ~ N(0, diag(sigma_x², sigma_y²)).

    Attributes:
        scale: multiplies both sigmas: what the margin of a sensor's specification is asked in.
        shape: makes the standardised noise u of z, in unit variance.
    """

    longitudinal_slope: Annotated[float, msgspec.Meta(ge=0.0, le=1.0)] = 0.02
    longitudinal_base_m: Annotated[float, msgspec.Meta(gt=0.0, le=100.0)] = 1.0
    lateral_slope: Annotated[float, msgspec.Meta(ge=0.0, le=1.0)] = 0.00625
    lateral_base_m: Annotated[float, msgspec.Meta(gt=0.0, le=100.0)] = 0.2
    scale: Annotated[float, msgspec.Meta(gt=0.0, le=10.0)] = 1.0
    shape: Shape = White()

    def in_words(self) -> dict[str, str]:
        """What people read, by name."""
        along, across = self.longitudinal_base_m, self.lateral_base_m
        return {
            "longitudinal sigma": f"{self.longitudinal_slope:g}·|dx| + {along:g} m",
            "lateral sigma": f"{self.lateral_slope:g}·|dy| + {across:g} m",
            "scale": f"both sigmas × {self.scale:g}",
            "shape": self.shape.in_words(),
        }


class Conversion:
    """Converts the noise of one episode, step by step from its start, in either direction.

    On a road, metres are added to the perceived position of the nearest vehicle; should another
    vehicle become the nearest, the noise goes on.
    """

    def __init__(self, shape: Shape) -> None:
        self._shape = shape
        self._before: Row | None = None

    def to_metres(self, z: Row, sigma: Row) -> Row:
        """a_t = sigma_t · u_t, on a road in metres."""
        u = self._shape.step(z, self._before)
        self._before = u
        return tuple([each * at for each, at in zip(u, sigma, strict=True)])

    def to_z(self, a: Row, sigma: Row) -> Row:
        """z_t of what was injected at that sigma."""
        u = tuple([each / at for each, at in zip(a, sigma, strict=True)])
        z = self._shape.step_back(u, self._before)
        self._before = u
        return z


AXES = ("longitudinal", "lateral")
"""The channels of every world with a road: the two components of the noise of a position.

A channel is one way in which perception may be wrong; z has a column for each, in this order.
"""


Doubles = NDArray[np.float64]

TRAJECTORIES_AT_A_TIME = 64
"""Number of trajectories whose densities are computed together: as fast as with more, and their
doubles stay in the cache of the processor."""


class NoiseTrajectory(Brief, Tabular, msgspec.Struct, frozen=True, eq=False, dict=True):
    """The disturbances of one episode, step by step, up to its end.

    Attributes:
        z: the standard normal draws behind the noise, shape (steps, channels); on a road the
            channels are `AXES`.
        sigma: standard deviations at each step, shape (steps, channels). [m]
        shape: how the noise came of z.
    """

    z: Floats
    sigma: Floats
    shape: Shape = White()

    @classmethod
    def from_metres(cls, metres: Doubles, sigma: Floats, shape: Shape) -> "NoiseTrajectory":
        """The noise that injects these, shape (steps, channels), to the precision of float32."""
        z = _convert(Conversion(shape).to_z, metres, sigma)
        return cls(z.astype(np.float32), sigma, shape)

    @cached_property
    def metres(self) -> Doubles:
        """The disturbances a_t added to what is perceived, shape (steps, channels). [m]"""
        return _convert(Conversion(self.shape).to_metres, self.z, self.sigma)

    @cached_property
    def standardised(self) -> Doubles:
        """u_t = a_t / sigma_t, of mean 0 and variance 1, shape (steps, channels). [sigma]"""
        return _convert(Conversion(self.shape).to_metres, self.z, np.ones_like(self.z))

    @cached_property
    def log_probability(self) -> float:
        """log p(a_1 … a_T): the sum over the steps until the episode ended."""
        return sum_log_densities([self])[0]

    @cached_property
    def log_probability_per_step(self) -> Doubles:
        """log p(a_t | a_1 … a_{t-1}) of every step, shape (steps,); a in metres.

        On each channel log N(z_t) - log sigma_t - log |du_t/dz_t|: a change of variables whose
        Jacobian is triangular, since u_t depends on no later z.
        """
        return _find_log_densities([self])


def sum_log_densities(trajectories: Sequence[NoiseTrajectory]) -> list[float]:
    """The `log_probability` of each trajectory; all have the same number of channels.

    The steps are not kept: a hub holds thousands of results, and needs the sums alone.
    """
    sums: list[float] = []
    for first in range(0, len(trajectories), TRAJECTORIES_AT_A_TIME):
        some = trajectories[first : first + TRAJECTORIES_AT_A_TIME]
        densities = _find_log_densities(some)
        sums += [float(np.add.reduce(densities[steps])) for steps in _find_steps(some)]
    return sums


def _find_log_densities(trajectories: Sequence[NoiseTrajectory]) -> Doubles:
    """log p of every step of the trajectories, one after the other, shape (all steps,)."""
    z = np.concatenate([each.z for each in trajectories], dtype=np.float64)
    sigma = np.concatenate([each.sigma for each in trajectories], dtype=np.float64)
    density: Doubles = -0.5 * z**2 - np.log(sigma) - LOG_SQRT_TWO_PI
    density -= np.concatenate(
        [
            each.shape.log_slopes(z[steps])
            for each, steps in zip(trajectories, _find_steps(trajectories), strict=True)
        ]
    )
    total: Doubles = density.sum(axis=1)
    return total


def _find_steps(trajectories: Sequence[NoiseTrajectory]) -> list[slice]:
    """Which steps are those of each trajectory, where they follow each other."""
    ends = [*accumulate([len(each.z) for each in trajectories])]
    return [slice(*bounds) for bounds in zip([0, *ends[:-1]], ends, strict=True)]


def _convert(
    step: Callable[[Row, Row], Row], values: NDArray[np.floating], sigma: Floats
) -> Doubles:
    """Every row of an array with its sigma taken through one step of a conversion."""
    rows = zip(values.tolist(), sigma.tolist(), strict=True)
    return np.array([step(value, at) for value, at in rows]).reshape(values.shape)
