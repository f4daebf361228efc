"""Rates with 95 % intervals, and intervals of estimates."""

from collections.abc import Callable
from math import exp, inf, lgamma, log, sqrt
from statistics import NormalDist

from eigenfail.intervals import ERROR, find_interval, refuse_no_share
from eigenfail.values.estimates import Interval, Rate


def rate(k: int, n: int, errored: int = 0, unresolved: int = 0) -> Rate:
    """Return the rate k of n, with the interval for a number of trials that was fixed beforehand.

    Args:
        k: number of events.
        n: number of completed trials.
        errored: number of errored trials besides the n.
        unresolved: number of trials among the n that ended before a possible event.

    Raises:
        InvalidValue: n is 0, or not 0 <= k <= n.
    """
    refuse_no_share(k, n)
    bounds = find_interval(k, n + errored, errored + unresolved)
    return Rate(k / n, k, n, bounds, errored=errored, unresolved=unresolved)


def clopper_pearson(k: int, n: int) -> Interval:
    """Return the exact two-sided interval of a probability after k events in n trials.

    It holds all p for which neither k or more nor k or fewer events have a probability below 2.5 %.
    Source: Clopper and Pearson 1934, Biometrika 26, 404–413.
    """
    from scipy.special import betaincinv  # imported late: the API starts sooner without it

    tail = ERROR / 2.0
    low = float(betaincinv(k, n - k + 1, tail)) if k else 0.0
    return Interval(low, float(betaincinv(k + 1, n - k, 1.0 - tail)) if k < n else 1.0)


def bound_stated_share(k: int, n: int, most: int) -> Interval:
    """Return the interval of a probability that is stated only if an event was seen.

    If events are unlikely in n trials, a share is rarely stated, and is then too large. So the
    lower end is exact given at least one event: the p at which P(k or more | 1 or more) is 2.5 %. A
    single event excludes no p. Its lower end comes from `clopper_pearson`, which fails only if
    fewer than one in forty such trials have an event. The upper end comes from `clopper_pearson`,
    which holds at least as often given an event.

    Args:
        k: number of events, at least 1.
        n: number of trials.
        most: number of events if each trial without a result counts as an event.
    """
    from scipy.special import betainc  # imported late: the API starts sooner without it

    low, high = clopper_pearson(k, n).low, clopper_pearson(most, n).high
    tail = ERROR / 2.0

    def is_unlikely(p: float) -> bool:
        return bool(betainc(k, n - k + 1, p) <= tail * betainc(1, n, p))

    return Interval(_find_end(is_unlikely, 0.0, low) if k > 1 else low, high)


PRIOR = 0.5
"""Both parameters of the mixing Beta distribution of `confidence_sequence`: near 0 and 1, where
failures are rare or the rule, its sets are narrower than those of the uniform distribution."""

# 2^-60 of the way is less than the distance of doubles near 1: more halvings change nothing.
BISECTIONS = 60


def confidence_sequence(k: int, n: int) -> Interval:
    """Return a set of p that holds the truth after all trials simultaneously, with 95 %.

    You may inspect it after each trial, and stop the trials at any time for any reason. Consider
    the likelihood of the outcomes, averaged over Beta(1/2, 1/2) and divided by the likelihood at
    the true p. This ratio is a martingale of mean 1. By Ville's inequality, it ever exceeds 1 ÷
    0.05 in at most 5 % of sequences. The set holds the p whose ratio is below 1 ÷ 0.05:

        B(k + 1/2, n − k + 1/2) ÷ B(1/2, 1/2) < p^k · (1 − p)^(n − k) ÷ 0.05.

    Source: Robbins 1970, Annals of Mathematical Statistics 41, 1397–1409; Howard, Ramdas, McAuliffe
    and Sekhon 2021, Annals of Statistics 49, 1055–1080.

    Raises:
        InvalidValue: n is 0, or not 0 <= k <= n.
    """
    refuse_no_share(k, n)
    averaged = _log_beta(k + PRIOR, n - k + PRIOR) - _log_beta(PRIOR, PRIOR)
    least = averaged + log(ERROR)

    def is_inside(p: float) -> bool:
        return _log_power(p, k) + _log_power(1.0 - p, n - k) > least

    return Interval(_find_end(is_inside, k / n, 0.0), _find_end(is_inside, k / n, 1.0))


def bound_sequence(k: int, n: int, doubtful: int = 0) -> Interval:
    """Return the confidence sequence of n trials, with doubtful trials besides the k events.

    As in `find_interval`, the upper end counts doubtful trials as events.

    Raises:
        InvalidValue: n is 0, or not 0 <= k <= n.
    """
    found = confidence_sequence(k, n)
    if not doubtful:
        return found
    return Interval(found.low, confidence_sequence(min(k + doubtful, n), n).high)


def _find_end(is_inside: Callable[[float], bool], inside: float, outside: float) -> float:
    """Return the end of a set on the way from a point inside to a second point."""
    # The set of p reaches 0 or 1 where all trials ended alike; there is no end to bisect for.
    if is_inside(outside):
        return outside
    for _ in range(BISECTIONS):
        middle = (inside + outside) / 2.0
        inside, outside = (middle, outside) if is_inside(middle) else (inside, middle)
    return outside


def _log_beta(a: float, b: float) -> float:
    return lgamma(a) + lgamma(b) - lgamma(a + b)


def _log_power(p: float, times: int) -> float:
    """Return times · log p: 0 if `times` is 0, otherwise minus infinity for p = 0."""
    if not times:
        return 0.0
    return times * log(p) if p > 0.0 else -inf


def log_normal(probability: float, cv: float, effective: float = inf) -> Interval:
    """Return the 95 % interval of a probability above 0 with a log-normal estimate.

    The interval is probability · exp(±q·s), with s² = log(1 + cv²) for a coefficient of variation
    cv. If cv was estimated from `effective` independent samples, q is the quantile of Student's
    distribution with `effective` − 1 degrees of freedom, at least 1. If cv is known, q is `Z`.
    """
    quantile = find_quantile(1.0 - ERROR / 2.0, effective)
    factor = exp(quantile * sqrt(log(1.0 + cv * cv)))
    return Interval(probability / factor, min(probability * factor, 1.0))


def find_quantile(level: float, effective: float) -> float:
    """Return the quantile of an error whose size was estimated from independent samples.

    It is Student's quantile with `effective` − 1 degrees of freedom, at least 1. If `effective` is
    infinite, the size is known, and the quantile is normal.
    """
    if effective == inf:
        return NormalDist().inv_cdf(level)
    from scipy.special import stdtrit  # imported late: the API starts sooner without it

    return float(stdtrit(max(effective - 1.0, 1.0), level))
