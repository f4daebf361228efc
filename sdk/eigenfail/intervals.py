"""95 % intervals of a probability from k events in n trials whose number was fixed beforehand."""

from collections.abc import Callable
from math import exp, inf, log, sqrt
from statistics import NormalDist

from eigenfail.errors import InvalidValue
from eigenfail.values import Interval
from eigenfail.values.student_t import split_t_mass

ERROR = 0.05
Z = NormalDist().inv_cdf(1.0 - ERROR / 2.0)

HALVINGS = 60

NEARLY_NORMAL = 1e-6
"""Relative difference of a quantile from the normal one that is taken for none."""

MOST_FREEDOM = 1e9


def find_interval(k: int, n: int) -> Interval:
    """The 95 % interval of a probability after k events in n trials.

    Wilson's score interval in between; where all trials ended alike only one side is open, and all
    5 % are spent on that side.

    Raises:
        InvalidValue: no trial, or not 0 <= k <= n.
    """
    refuse_no_share(k, n)
    if k == 0:
        return Interval(0.0, upper_bound_of_none(n))
    if k == n:
        return Interval(1.0 - upper_bound_of_none(n), 1.0)
    return wilson(k, n)


def refuse_no_share(k: int, n: int) -> None:
    """Make sure that k of n is a share.

    Raises:
        InvalidValue: no trial, or not 0 <= k <= n.
    """
    if not (n >= 1 and 0 <= k <= n):
        raise InvalidValue("k of n", f"{k} of {n} is no share.", "Count at least one trial.")


def wilson(k: int, n: int) -> Interval:
    """The two-sided score interval (Wilson 1927, J. Am. Stat. Assoc. 22, 209–212).

    All p at which k is at most `Z` standard deviations from n·p: (k − n·p)² = Z²·n·p·(1 − p).
    Averaged over p it holds the truth in 95 % of cases; at its worst, near n·p = 0.17, in 84 %,
    since its lower end is a little high after a single event.
    """
    centre = (k + Z**2 / 2.0) / (n + Z**2)
    half_width = Z / (n + Z**2) * sqrt(k * (n - k) / n + Z**2 / 4.0)
    return Interval(max(0.0, centre - half_width), min(1.0, centre + half_width))


def upper_bound_of_none(n: int) -> float:
    """The one-sided 95 % upper bound after no event in n trials, near 3 / n.

    Exact: the p at which (1 − p)^n = 0.05 (Clopper and Pearson 1934, Biometrika 26, 404–413).
    """
    return float(1.0 - ERROR ** (1.0 / n))


def find_t_freedom(quantile: float) -> float:
    """Return the degrees of freedom of Student's distribution that has this 97.5 % quantile.

    They are 1 or more; infinite where the quantile is that of the normal distribution.
    """
    if quantile <= Z * (1.0 + NEARLY_NORMAL):
        return inf
    return exp(
        find_crossing(0.0, log(MOST_FREEDOM), lambda at: split_t_mass(quantile, exp(at))[1] > ERROR)
    )


def find_crossing(low: float, high: float, is_below: Callable[[float], bool]) -> float:
    """Return where a condition that holds at the low end stops holding."""
    for _ in range(HALVINGS):
        middle = (low + high) / 2.0
        low, high = (middle, high) if is_below(middle) else (low, middle)
    return high
