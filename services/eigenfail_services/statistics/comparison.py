"""Comparisons of two samples: failure rates, paired episodes, effect sizes, rank correlation."""

from collections.abc import Sequence
from math import atanh, comb, sqrt, tanh

import numpy as np
from numpy.typing import NDArray

from eigenfail.errors import InvalidValue
from eigenfail.intervals import Z
from eigenfail.values import (
    Difference,
    EffectSize,
    Figure,
    Interval,
    Magnitude,
    McNemar,
    PairTotals,
    Rate,
)


def difference(a: Rate, b: Rate) -> Difference:
    """Return the rate of b minus that of a, with its 95 % interval, for independent samples.

    Newcombe's hybrid score interval: with the intervals (l, u) of the two rates p, Wilson's,
    d − sqrt((p_b − l_b)² + (u_a − p_a)²) to d + sqrt((u_b − p_b)² + (p_a − l_a)²). Of paired
    samples that mostly agree it is wider than it need be: see `mcnemar`.
    Source: Newcombe 1998, Statistics in Medicine 17, 873–890, method 10; with other intervals:
    Zou and Donner 2008, Statistics in Medicine 27, 1693–1702.

    Args:
        a: with a two-sided interval. Of a rate without an estimate, the share is taken.
        b: the same.

    Raises:
        InvalidValue: a rate without an interval.
    """
    for rate in (a, b):
        if rate.interval is None:
            problem = f"{rate.k} of {rate.n} has no interval."
            raise InvalidValue("rate", problem, "Compare random samples.")
    (p_a, low_a, high_a), (p_b, low_b, high_b) = map(_place_rate, (a, b))
    value = p_b - p_a
    low = value - sqrt((p_b - low_b) ** 2 + (high_a - p_a) ** 2)
    high = value + sqrt((high_b - p_b) ** 2 + (p_a - low_a) ** 2)
    return Difference(value, Interval(max(-1.0, low), min(1.0, high)), a.n, b.n)


def _place_rate(rate: Rate) -> tuple[float, float, float]:
    """Return the estimate of a rate, inside its interval, and both ends of that."""
    bounds = rate.interval or Interval(0.0, 1.0)
    value = rate.share if rate.value is None else rate.value
    return min(max(value, bounds.low), bounds.high), bounds.low, bounds.high


def mcnemar(pairs: PairTotals) -> McNemar:
    """Return McNemar's exact test: only pairs in which just one side failed distinguish the sides.

    If both sides were equally prone to fail, each would be that one with probability 1/2: the
    p-value is twice the binomial tail of the rarer, at most 1. Source: McNemar 1947, Psychometrika
    12, 153–157.
    """
    from scipy.special import bdtr  # imported late: the API starts sooner without it

    rarer = min(pairs.only_first, pairs.only_second)
    discordant = pairs.only_first + pairs.only_second
    return McNemar(
        n=pairs.n,
        both=pairs.both,
        only_a=pairs.only_first,
        only_b=pairs.only_second,
        neither=pairs.neither,
        p_value=min(1.0, 2.0 * float(bdtr(rarer, discordant, 0.5))),
    )


SIGNIFICANCE = 0.05


def can_distinguish(n_a: int, n_b: int) -> bool:
    """Whether so many values a side could show a difference at all, were they fully apart.

    The p-value of the exact rank-sum test is then 2 ÷ (n_a + n_b over n_a), the smallest there is
    (Mann and Whitney 1947, Annals of Mathematical Statistics 18, 50–60): 0.33 with two values on
    each side, 0.1 with three, 0.029 with four.
    """
    return 2.0 / comb(n_a + n_b, n_a) <= SIGNIFICANCE


THRESHOLDS = (
    (0.21, Magnitude.LARGE),
    (0.14, Magnitude.MEDIUM),
    (0.06, Magnitude.SMALL),
)
"""Least |A12 − 1/2| of an effect of each magnitude."""

EFFECT_ROUNDING = 1e-9


def effect_size(a: Sequence[float], b: Sequence[float]) -> EffectSize:
    """Return A12 of b over a: P(b > a) + P(b = a) / 2 for a value of each, drawn at random.

    Source: Vargha and Delaney 2000, Journal of Educational and Behavioral Statistics 25, 101–132.

    Raises:
        InvalidValue: so few values that chance would set them apart, too.
    """
    if not can_distinguish(len(a), len(b)):
        problem = f"{len(a)} and {len(b)} values have no effect size that says anything."
        raise InvalidValue("values", problem, "Give four on each side, or three and five.")
    wins = sum((y > x) + (y == x) / 2.0 for x in a for y in b)
    a12 = wins / (len(a) * len(b))
    return EffectSize(a12, name_magnitude(a12), len(a), len(b))


def name_magnitude(a12: float) -> Magnitude:
    """Return the name of an effect of this size."""
    away = abs(a12 - 0.5) + EFFECT_ROUNDING
    return next((name for least, name in THRESHOLDS if away >= least), Magnitude.NEGLIGIBLE)


Array = NDArray[np.float64]

LEAST_PAIRS = 10


def rank_correlation(one: Array, other: Array) -> Figure | None:
    """Return Spearman's ρ, the correlation of ranks; equal values share their mean rank.

    The interval is tanh(atanh ρ ± Z·√((1 + ρ²/2) ÷ (n − 3))) (Bonett and Wright 2000,
    Psychometrika 65, 23–28).

    Args:
        one: shape (n,).
        other: shape (n,).

    Returns:
        None over fewer than ten pairs, or where one of them does not vary.
    """
    ranks = [_rank(values) for values in (one, other)]
    if len(one) < LEAST_PAIRS or any(np.ptp(each) == 0.0 for each in ranks):
        return None
    rho = min(max(float(np.corrcoef(ranks[0], ranks[1])[0, 1]), -1.0), 1.0)
    if abs(rho) >= 1.0:
        return Figure(rho, Interval(rho, rho))
    error = Z * sqrt((1.0 + rho * rho / 2.0) / (len(one) - 3))
    return Figure(rho, Interval(tanh(atanh(rho) - error), tanh(atanh(rho) + error)))


def _rank(values: Array) -> Array:
    # scipy.stats.rankdata gives the same, but its import takes half a second of the first answer.
    _, places, counts = np.unique(values, return_inverse=True, return_counts=True)
    last = np.cumsum(counts)
    middle: Array = (2 * last - counts + 1) / 2.0
    return middle[places]
