"""Mean, spread and ratio over independent repetitions, such as the seeds of a search."""

from collections.abc import Sequence
from math import inf, sqrt
from typing import NamedTuple

import numpy as np

from eigenfail.errors import InvalidValue
from eigenfail.intervals import ERROR
from eigenfail.values.estimates import Interval
from eigenfail.values.seeds import SeedFigure
from eigenfail_services.statistics.intervals import find_quantile

ROUNDING = 1e-9
"""Relative width below which an interval is the rounding of equal values."""


def measure_spread(
    values: Sequence[float], lowest: float = -inf, highest: float = inf
) -> SeedFigure:
    """Return mean, standard deviation, range and Student's 95 % interval of the mean.

    The interval is mean ± t · s ÷ √n, with t the quantile of Student's distribution with n − 1
    degrees of freedom (Student 1908, Biometrika 6, 1–25). It is cut at the bounds of possible
    values. The mean cannot be outside them, so the cut loses no coverage. The interval is exact for
    normal values. For shares that are 0 for some seeds and large for others, it covers the mean
    less often.

    Args:
        values: one of each repetition.
        lowest: smallest value that is possible.
        highest: largest value that is possible.

    Raises:
        InvalidValue: `values` is empty.
    """
    n = len(values)
    if n < 1:
        raise InvalidValue("values", "there are none.", "Give at least one.")
    ordered = np.sort(np.asarray(values, np.float64))
    least, most = float(ordered[0]), float(ordered[-1])
    # The sum of equal values may round away from them.
    mean = least if least == most else float(ordered.mean())
    deviation = None if n < 2 else 0.0 if least == most else float(ordered.std(ddof=1))
    interval = None
    # Equal values have no spread from which an interval could follow.
    if deviation:
        half_width = find_quantile(1.0 - ERROR / 2.0, n) * deviation / sqrt(n)
        interval = Interval(max(mean - half_width, lowest), min(mean + half_width, highest))
    return SeedFigure(
        n=n,
        mean=mean,
        deviation=deviation,
        least=least,
        median=float(np.median(ordered)),
        most=most,
        interval=interval,
    )


class PairSums(NamedTuple):
    """Sums over pairs of a price and a number of failures, for computing their ratio.

    Attributes:
        n: number of pairs.
        price: sum of the prices.
        failures: sum of the failures.
        price_squares: sum of the squared prices.
        failure_squares: sum of the squared numbers of failures.
        products: sum of price × failures.
    """

    n: int
    price: float
    failures: float
    price_squares: float
    failure_squares: float
    products: float

    @classmethod
    def of(cls, prices: Sequence[float], failures: Sequence[float]) -> "PairSums":
        """Return the sums over pairs of elements at equal places."""
        p, f = np.asarray(prices, np.float64), np.asarray(failures, np.float64)
        sums = (p.sum(), f.sum(), (p * p).sum(), (f * f).sum(), (p * f).sum())
        return cls(len(p), *map(float, sums))


class Ratio(NamedTuple):
    """The ratio of two sums over repetitions.

    Attributes:
        value: the ratio.
        interval: its 95 % interval; None if it is unbounded above, or if nothing varied.
        at_least: its lower end; None without a lower bound above 0.
    """

    value: float
    interval: Interval | None
    at_least: float | None


def find_ratio(sums: PairSums) -> Ratio:
    """Return total price ÷ total failures, with the 95 % interval of E[price] ÷ E[failures].

    Fieller's interval holds all R for which the mean of price − R · failures is within t standard
    errors of 0: (m_f² − h_ff) R² − 2 (m_p m_f − h_pf) R + m_p² − h_pp ≤ 0. Here m are means, h = t²
    · (co)variance ÷ n, and t is Student's quantile with n − 1 degrees of freedom. A repetition
    without failures is a pair like any other. If the number of failures is not distinguished from 0
    (m_f² ≤ h_ff), every high price is possible, and only the lower end remains. Source: Fieller
    1954, Journal of the Royal Statistical Society B 16, 175–185.

    Raises:
        InvalidValue: all pairs are without failures.
    """
    n, price, failures = sums.n, sums.price / sums.n, sums.failures / sums.n
    if failures <= 0.0:
        raise InvalidValue("failures", "there is no failure.", "Take a bound in place of a ratio.")
    value = price / failures
    if n < 2 or price <= 0.0:
        return Ratio(value, None, None)
    factor = find_quantile(1.0 - ERROR / 2.0, n) ** 2 / (n * (n - 1))
    square = failures**2 - factor * max(sums.failure_squares - n * failures**2, 0.0)
    half = price * failures - factor * (sums.products - n * price * failures)
    constant = price**2 - factor * max(sums.price_squares - n * price**2, 0.0)
    root = sqrt(max(half**2 - square * constant, 0.0))
    # Pairs that are all in one proportion leave an interval of rounding alone.
    if root <= ROUNDING * abs(half):
        return Ratio(value, None, None)
    if square > 0.0:
        low, high = max((half - root) / square, 0.0), (half + root) / square
        return Ratio(value, Interval(low, high), low or None)
    # A parabola that opens downward: what is left above 0 begins at its positive root.
    return Ratio(value, None, constant / (half + root) if constant > 0.0 else None)
