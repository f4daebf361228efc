"""Judgements of differences: whether one group of failures is rarer, likelier or more severe."""

from collections.abc import Sequence
from math import hypot
from statistics import fmean, stdev

from eigenfail.intervals import Z, bound_rate
from eigenfail.values.comparison import Comparison
from eigenfail.values.estimates import Rate
from eigenfail.values.safety import Safety

Judgement = bool | None
"""Whether a statement or a part of it holds; None where an interval includes no difference."""


FEWEST_FAILURES = 10
"""Means over fewer failures are not compared, as the interval below needs large samples; fewer have
no rank correlation, either."""


def has_enough(*safeties: Safety) -> bool:
    """Whether all campaigns have enough failures for means over them."""
    return all(len(each.scatter.points) >= FEWEST_FAILURES for each in safeties)


def is_likelier(a: Safety, b: Safety) -> Judgement:
    """Whether the failures of B have a higher mean log p per step; None if that is uncertain."""
    one, other = ([p.log_probability_per_step for p in s.scatter.points] for s in (a, b))
    return is_greater(one, other)


def is_more_severe(a: Safety, b: Safety) -> Judgement:
    """Whether the failures of B have a higher mean severity; None if that is uncertain."""
    one, other = ([point.severity for point in s.scatter.points] for s in (a, b))
    return is_greater(one, other)


def is_greater(a: Sequence[float], b: Sequence[float]) -> Judgement:
    """Whether the mean of B is greater; None if the 95 % interval includes 0.

    The interval is Welch's (1947) for large samples: two normal means, each with its own variance.
    """
    if min(len(a), len(b)) < FEWEST_FAILURES:
        return None
    difference = fmean(b) - fmean(a)
    error = hypot(*(stdev(values) / len(values) ** 0.5 for values in (a, b)))
    return None if abs(difference) <= Z * error else difference > 0.0


def is_rarer(a: Rate | None, b: Rate | None) -> Judgement:
    """Whether A's rate is the lower one; None if the intervals overlap."""
    if a is None or b is None:
        return None
    one, other = (bound_rate(rate) for rate in (a, b))
    below, above = one.high < other.low, one.low > other.high
    return below if below or above else None


def is_above_half(rate: Rate | None) -> Judgement:
    """Whether more than half of the draws fail; None if the interval includes one half."""
    if rate is None:
        return None
    interval = bound_rate(rate)
    return None if interval.low <= 0.5 <= interval.high else rate.share > 0.5


def fails_more_often(comparison: Comparison) -> Judgement:
    """Whether B fails more often than A, by Newcombe's interval."""
    difference = comparison.difference
    if difference is None or difference.interval.low <= 0.0 <= difference.interval.high:
        return None
    return difference.value > 0.0


def combine(*parts: Judgement) -> Judgement:
    """Judge a statement of several parts: false if one is, open if one is open and none false."""
    open_or_true = None if None in parts else True
    return False if False in parts else open_or_true


def agree(choices: Sequence[Judgement]) -> Judgement:
    """Return what all choices that the paper leaves open give; None if they differ."""
    first, *others = choices or (None,)
    return first if all(other is first for other in others) else None
