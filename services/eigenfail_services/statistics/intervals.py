"""Rates with their 95 % intervals, and the intervals of estimates."""

from math import exp, inf, log, sqrt
from statistics import NormalDist

from msgspec.structs import replace

from eigenfail.intervals import ERROR, find_interval
from eigenfail.values import Interval, Rate


def rate(k: int, n: int) -> Rate:
    """Return k of n, with the interval of a number of trials that was fixed beforehand.

    Raises:
        InvalidValue: no trial, or not 0 <= k <= n.
    """
    bounds = find_interval(k, n)
    return Rate(k / n, k, n, bounds)


def stopped_rate(k: int, n: int) -> Rate:
    """Return k of n, where the trials ended once there were enough events, or at their limit.

    The interval holds at such a stop; the share itself is too large on average.

    Raises:
        InvalidValue: no trial, or not 0 <= k <= n.
    """
    fixed = rate(k, n)
    return replace(fixed, interval=clopper_pearson(k, n)) if 0 < k < n else fixed


def clopper_pearson(k: int, n: int) -> Interval:
    """Return the exact two-sided interval of a probability after k events in n trials.

    All p at which neither k or more nor k or fewer events have a probability below 2.5 %. It also
    holds where the trials ended with the k-th event (inverse sampling, Haldane 1945, Biometrika 33,
    222–225): P(N <= n) = P(at least k events in n trials) gives the same lower end, and the upper
    end of that case is smaller. Wilson's interval does not hold there: where the first event ends
    the trials, it contains the truth in as few as 79 % of cases.
    Source: Clopper and Pearson 1934, Biometrika 26, 404–413.
    """
    from scipy.special import betaincinv  # imported late: the API starts sooner without it

    tail = ERROR / 2.0
    low = float(betaincinv(k, n - k + 1, tail)) if k else 0.0
    return Interval(low, float(betaincinv(k + 1, n - k, 1.0 - tail)) if k < n else 1.0)


def log_normal(probability: float, cv: float, effective: float = inf) -> Interval:
    """The 95 % interval of a probability above 0 whose estimate is log-normal about it.

    exp(±q·s) around it, s² = log(1 + cv²) for a coefficient of variation cv. q is the quantile of
    Student's distribution with `effective` − 1 degrees of freedom, at least 1, where cv was itself
    estimated from that many independent samples; `Z` where it is known.
    """
    quantile = find_quantile(1.0 - ERROR / 2.0, effective)
    factor = exp(quantile * sqrt(log(1.0 + cv * cv)))
    return Interval(probability / factor, min(probability * factor, 1.0))


def find_quantile(level: float, effective: float) -> float:
    """Return the quantile of an error whose size was estimated from some independent samples.

    It is Student's, with `effective` − 1 degrees of freedom and at least 1; the normal one where
    `effective` is infinite: the size is known.
    """
    if effective == inf:
        return NormalDist().inv_cdf(level)
    from scipy.special import stdtrit  # imported late: the API starts sooner without it

    return float(stdtrit(max(effective - 1.0, 1.0), level))
