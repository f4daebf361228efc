"""Two failure rates: their difference, and McNemar's test where episodes are paired."""

from math import exp, lgamma, log, sqrt

from eigenfail.errors import InvalidValue
from eigenfail.values import Difference, Interval, McNemar, PairTotals
from eigenfail_services.statistics.intervals import wilson

NEGLIGIBLE = 1e-17
"""A share of a sum that no double can hold any more."""


def difference(k_a: int, n_a: int, k_b: int, n_b: int) -> Difference:
    """k_b of n_b minus k_a of n_a, with its 95 % interval, for independent samples.

    Newcombe's hybrid score interval: with the Wilson intervals (l, u) of the two shares p,
    d − sqrt((p_b − l_b)² + (u_a − p_a)²) to d + sqrt((u_b − p_b)² + (p_a − l_a)²). Of paired
    samples that mostly agree it is wider than it need be: see `mcnemar`.
    Source: Newcombe 1998, Statistics in Medicine 17, 873–890, method 10.

    Raises:
        InvalidValue: no trial, or not 0 <= k <= n.
    """
    for k, n in ((k_a, n_a), (k_b, n_b)):
        if not (n >= 1 and 0 <= k <= n):
            raise InvalidValue("k of n", f"{k} of {n} is no share.", "Count at least one trial.")
    p_a, p_b, a, b = k_a / n_a, k_b / n_b, wilson(k_a, n_a), wilson(k_b, n_b)
    value = p_b - p_a
    low = value - sqrt((p_b - b.low) ** 2 + (a.high - p_a) ** 2)
    high = value + sqrt((b.high - p_b) ** 2 + (p_a - a.low) ** 2)
    return Difference(value, Interval(max(-1.0, low), min(1.0, high)), n_a, n_b)


def mcnemar(pairs: PairTotals) -> McNemar:
    """McNemar's exact test: only pairs in which just one side failed tell the sides apart.

    If both were equally prone to fail, a side would be that one with probability 1/2: twice the
    binomial tail of the rarer, at most 1. Source: McNemar 1947, Psychometrika 12, 153–157.
    """
    rarer = min(pairs.only_first, pairs.only_second)
    discordant = pairs.only_first + pairs.only_second
    return McNemar(
        n=pairs.n,
        both=pairs.both,
        only_a=pairs.only_first,
        only_b=pairs.only_second,
        neither=pairs.neither,
        p_value=min(1.0, 2.0 * fair_tail(rarer, discordant)),
    )


def fair_tail(most: int, n: int) -> float:
    """P(k <= most) for k of n tosses of a fair coin, summed from its largest term down."""
    term = exp(lgamma(n + 1) - lgamma(most + 1) - lgamma(n - most + 1) - n * log(2.0))
    total = 0.0
    for k in range(most, -1, -1):
        total += term
        if term < NEGLIGIBLE * total:
            break
        term *= k / (n - k + 1)
    return total
