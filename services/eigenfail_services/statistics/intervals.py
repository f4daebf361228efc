"""Rates with their 95 % intervals, and the intervals of estimates."""

from collections.abc import Callable
from math import exp, inf, lgamma, log, sqrt
from statistics import NormalDist

from eigenfail.intervals import ERROR, find_interval, refuse_no_share
from eigenfail.values.estimates import Interval, Rate


def rate(k: int, n: int, errored: int = 0, unresolved: int = 0) -> Rate:
    """Return k of n, with the interval of a number of trials that was fixed beforehand.

    Args:
        k: number of events.
        n: number of completed trials.
        errored: number of trials besides the n that did not come to their end.
        unresolved: number of trials among the n that ended before what may have become an event.

    Raises:
        InvalidValue: no trial, or not 0 <= k <= n.
    """
    refuse_no_share(k, n)
    bounds = find_interval(k, n + errored, errored + unresolved)
    return Rate(k / n, k, n, bounds, errored=errored, unresolved=unresolved)


def clopper_pearson(k: int, n: int) -> Interval:
    """Return the exact two-sided interval of a probability after k events in n trials.

    All p at which neither k or more nor k or fewer events have a probability below 2.5 %.
    Source: Clopper and Pearson 1934, Biometrika 26, 404–413.
    """
    from scipy.special import betaincinv  # imported late: the API starts sooner without it

    tail = ERROR / 2.0
    low = float(betaincinv(k, n - k + 1, tail)) if k else 0.0
    return Interval(low, float(betaincinv(k + 1, n - k, 1.0 - tail)) if k < n else 1.0)


def bound_stated_share(k: int, n: int, most: int) -> Interval:
    """Return an interval of a probability that is stated only because an event was seen.

    If an event is unlikely in n trials, a share is stated rarely, and then it is too large. So
    the lower end is exact given at least one event: the p at which P(k or more | 1 or more) is
    2.5 %. One event alone excludes no p; its lower end is that of `clopper_pearson`, which fails
    only where fewer than one in forty such trials have an event. The upper end is that of
    `clopper_pearson`, which holds at least as often given an event.

    Args:
        k: number of events, at least 1.
        n: number of trials.
        most: number of events if each trial without a result was one.
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
    """Return the set of p that holds the truth after every trial at once, with 95 %.

    It may be looked at after each trial, and the trials may end at any look for any reason. The
    likelihood of the outcomes, averaged over Beta(1/2, 1/2) and divided by that of the true p, is
    a martingale of mean 1; by Ville's inequality it ever exceeds 1 ÷ 0.05 in at most 5 % of
    sequences. The set holds the p at which it is below that:

        B(k + 1/2, n − k + 1/2) ÷ B(1/2, 1/2) < p^k · (1 − p)^(n − k) ÷ 0.05.

    Source: Robbins 1970, Annals of Mathematical Statistics 41, 1397–1409; Howard, Ramdas, McAuliffe
    and Sekhon 2021, Annals of Statistics 49, 1055–1080.

    Raises:
        InvalidValue: no trial, or not 0 <= k <= n.
    """
    refuse_no_share(k, n)
    averaged = _log_beta(k + PRIOR, n - k + PRIOR) - _log_beta(PRIOR, PRIOR)
    least = averaged + log(ERROR)

    def is_inside(p: float) -> bool:
        return _log_power(p, k) + _log_power(1.0 - p, n - k) > least

    return Interval(_find_end(is_inside, k / n, 0.0), _find_end(is_inside, k / n, 1.0))


def bound_sequence(k: int, n: int, doubtful: int = 0) -> Interval:
    """Return the confidence sequence of n trials, of which some may be events besides the k.

    As in `find_interval`, the upper end counts the doubtful ones as events.

    Raises:
        InvalidValue: no trial, or not 0 <= k <= n.
    """
    found = confidence_sequence(k, n)
    if not doubtful:
        return found
    return Interval(found.low, confidence_sequence(min(k + doubtful, n), n).high)


def _find_end(is_inside: Callable[[float], bool], inside: float, outside: float) -> float:
    """Return where a set that holds one point ends on the way to another one."""
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
    """Return times · log p, which is 0 for no times and minus infinity for p = 0."""
    if not times:
        return 0.0
    return times * log(p) if p > 0.0 else -inf


def log_normal(probability: float, cv: float, effective: float = inf) -> Interval:
    """The 95 % interval of a probability above 0 whose estimate is log-normal about it.

    exp(±q·s) around it, s² = log(1 + cv²) for a coefficient of variation cv. q is the quantile of
    Student's distribution with `effective` − 1 degrees of freedom, at least 1, if cv was itself
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
