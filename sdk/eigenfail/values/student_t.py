"""Quantile map between Student's t and the standard normal, accurate far into both tails.

t(z) solves T(t) = Phi(z), where T is the distribution function of Student's t with nu degrees of
freedom. Beyond |z| = REACH, which one draw in 1e57 exceeds, t keeps its value at REACH.
"""

from functools import lru_cache
from math import copysign, erf, erfc, exp, lgamma, log, log1p, pi, sqrt
from statistics import NormalDist

REACH = 16.0
KNOTS_PER_SIGMA = 64
FRACTION_TERMS = 60
FAR = 1e150
"""Beyond this value, the square of t would overflow."""

SQRT_TWO = sqrt(2.0)
LOG_SQRT_TWO_PI = 0.5 * log(2.0 * pi)
# `inv_cdf` refuses 0, which is what smaller tails round to on the way back.
LEAST_TAIL = 0.5 * erfc(REACH / SQRT_TWO)
NORMAL = NormalDist()


def map_normal_to_t(z: float, nu: float) -> float:
    """Return t(z), to about ten digits; NaN counts as REACH."""
    # `min` returns its first argument where the second one is NaN.
    size = min(REACH, abs(z))
    # An odd function: one table serves both signs.
    return copysign(size * exp(_log_stretch(nu)(size)), z)


def map_t_to_normal(t: float, nu: float) -> float:
    """Return z with t(z) = t."""
    _, tails = split_t_mass(min(FAR, abs(t)), nu)
    return copysign(NORMAL.inv_cdf(max(0.5 * tails, LEAST_TAIL)), t)


def log_t_slope(z: float, nu: float) -> float:
    """Return log dt/dz = log φ(z) - log f(t), by differentiating T(t) = Φ(z)."""
    size = min(REACH, abs(z))
    return -0.5 * size * size - LOG_SQRT_TWO_PI - log_t_density(map_normal_to_t(size, nu), nu)


def log_t_density(t: float, nu: float) -> float:
    """Return log f(t) (Abramowitz and Stegun, 26.7.1)."""
    norm = lgamma(0.5 * (nu + 1.0)) - lgamma(0.5 * nu) - 0.5 * log(nu * pi)
    return norm - 0.5 * (nu + 1.0) * log1p(t * t / nu)


def split_t_mass(t: float, nu: float) -> tuple[float, float]:
    """Return P(|T| < t) and P(|T| > t) for t ≥ 0, the smaller one to nearly all of its digits.

    They are I_x(1/2, nu/2) and I_{1-x}(nu/2, 1/2) with x = t² / (nu + t²) (DLMF 8.17; Abramowitz
    and Stegun, 26.7.1). The function computes the one whose continued fraction converges fast.
    """
    x, rest = t * t / (nu + t * t), nu / (nu + t * t)
    # (a + 1) / (a + b + 2) with a = 1/2 and b = nu/2: the fraction converges fast below it.
    if x < 3.0 / (5.0 + nu):
        inside = _incomplete_beta(0.5, 0.5 * nu, x, rest)
        return inside, 1.0 - inside
    outside = _incomplete_beta(0.5 * nu, 0.5, rest, x)
    return 1.0 - outside, outside


def _incomplete_beta(a: float, b: float, x: float, rest: float) -> float:
    """Return I_x(a, b) (DLMF 8.17.22); x is at most (a + 1) / (a + b + 2), and rest is 1 - x."""
    fraction = 1.0
    # From the innermost term outwards.
    for m in range(FRACTION_TERMS, 0, -1):
        even = m * (b - m) * x / ((a + 2 * m - 1) * (a + 2 * m))
        odd = -(a + m) * (a + b + m) * x / ((a + 2 * m) * (a + 2 * m + 1))
        fraction = 1.0 + even / (1.0 + odd / fraction)
    fraction = 1.0 - (a + b) * x / (a + 1.0) / fraction
    beta = exp(lgamma(a) + lgamma(b) - lgamma(a + b))
    power: float = x**a * rest**b
    return power / (a * beta * fraction)


class LogStretch:
    """Table of log(t(z) / z) for 0 ≤ z ≤ REACH, with cubic Hermite polynomials between knots.

    An inversion costs a hundred times as much as a look-up in this table. The function is smooth
    and nearly a parabola. With 64 knots per sigma, the error stays below 1e-9.
    """

    def __init__(self, nu: float) -> None:
        self._nu = nu
        # At z = 0, t/z is the ratio of the two densities there.
        self._values = [-LOG_SQRT_TWO_PI - log_t_density(0.0, nu)]
        # The function is even.
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
        """Return the value at z."""
        at = z * KNOTS_PER_SIGMA
        # z = REACH belongs to the last piece.
        knot = min(int(at), len(self._values) - 2)
        s = at - knot
        left, right = self._values[knot], self._values[knot + 1]
        out, into = (slope / KNOTS_PER_SIGMA for slope in self._slopes[knot : knot + 2])
        rise = right - left
        return left + s * (out + s * (3 * rise - 2 * out - into + s * (out + into - 2 * rise)))


def _log_t(z: float, nu: float, guess: float) -> float:
    """Return log t with T(t) = Φ(z), z > 0, by Newton's method on the smaller mass's logarithm."""
    # Of the two masses the smaller one has its digits left: the other is rounded to nearly 1.
    central = z < 1.0
    target = log(erf(z / SQRT_TWO) if central else erfc(z / SQRT_TWO))
    log_t = guess
    # The guess has several digits, whose number each step of Newton's method about doubles.
    for _ in range(4):
        inside, outside = split_t_mass(exp(log_t), nu)
        mass = inside if central else -outside
        slope = 2.0 * exp(log_t_density(exp(log_t), nu) + log_t) / mass
        log_t -= (log(abs(mass)) - target) / slope
    return log_t


# A table for each nu, of which a campaign has few.
_log_stretch = lru_cache(maxsize=16)(LogStretch)
