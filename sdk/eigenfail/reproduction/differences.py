"""Whether the failures of one campaign are likelier or worse than those of another."""

from collections.abc import Sequence
from math import hypot
from statistics import NormalDist, fmean, stdev

from eigenfail.values import Rate, Safety

SURE = NormalDist().inv_cdf(0.975)
LEAST = 10
"""Of fewer failures on a side nothing is said."""


def likelier(a: Safety, b: Safety) -> bool | None:
    """Whether the failures of B have more log p per step; None where that is not sure."""
    one, other = ([p.log_probability_per_step for p in s.scatter.points] for s in (a, b))
    return greater(one, other)


def more_severe(a: Safety, b: Safety) -> bool | None:
    """Whether the failures of B are more severe; None where that is not sure."""
    one, other = ([point.severity for point in s.scatter.points] for s in (a, b))
    return greater(one, other)


def greater(a: Sequence[float], b: Sequence[float]) -> bool | None:
    """Whether the mean of B is the greater one; None where the 95 % interval holds 0.

    The interval is Welch's (1947) for large samples: two normal means, each with its own variance.
    """
    if min(len(a), len(b)) < LEAST:
        return None
    difference = fmean(b) - fmean(a)
    error = hypot(*(stdev(values) / len(values) ** 0.5 for values in (a, b)))
    return None if abs(difference) <= SURE * error else difference > 0.0


def above_half(rate: Rate | None) -> bool | None:
    """Whether more than half fail; None where the interval holds one half."""
    if rate is None or rate.interval.low <= 0.5 <= rate.interval.high:
        return None
    return rate.value > 0.5
