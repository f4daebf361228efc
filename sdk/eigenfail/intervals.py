"""95 % intervals of a probability from k events in n trials, and of the difference of two."""

from collections.abc import Callable
from math import exp, inf, lgamma, log, log1p, sqrt
from statistics import NormalDist

from eigenfail.errors import InvalidValue
from eigenfail.values.comparison import Difference, McNemar, PairTotals
from eigenfail.values.estimates import Interval, Rate

ERROR = 0.05
Z = NormalDist().inv_cdf(1.0 - ERROR / 2.0)

# 2^-60 is less than the distance of doubles near 1.
HALVINGS = 60


def find_interval(k: int, n: int, doubtful: int = 0) -> Interval:
    """Return the 95 % interval of a probability after k events in n trials.

    The upper end counts doubtful trials as events, the lower end does not: the interval assumes
    nothing about their outcomes. In general it is Wilson's score interval. If only one side is
    open, that side takes all 5 % of the error, and its end is exact.

    Args:
        k: number of trials that are known to be events.
        n: number of all trials.
        doubtful: number of further trials that may be events: they errored, or were cut short.

    Raises:
        InvalidValue: no trial, or not 0 <= k <= n.
    """
    refuse_no_share(k, n)
    most = min(k + doubtful, n)
    if k == 0:
        return Interval(0.0, find_upper_bound(most, n, ERROR))
    # With k < n, the lower end is still exact: no trial that is known to be none remains.
    if most == n:
        return Interval(find_lower_bound(k, n, ERROR), 1.0)
    return Interval(wilson(k, n).low, wilson(most, n).high)


def bound_rate(rate: Rate) -> Interval:
    """Return the interval of a rate as if its episodes were a random sample of a fixed number."""
    return find_interval(rate.k, rate.trials, rate.errored + rate.unresolved)


def bound_both_sides(rate: Rate) -> Interval:
    """Return Wilson's interval of a rate, even if all episodes ended alike.

    As in `find_interval`, the upper end counts errored and unresolved episodes as events.
    """
    most = min(rate.k + rate.errored + rate.unresolved, rate.trials)
    return Interval(wilson(rate.k, rate.trials).low, wilson(most, rate.trials).high)


def refuse_no_share(k: int, n: int) -> None:
    """Check that k of n is a share.

    Raises:
        InvalidValue: no trial, or not 0 <= k <= n.
    """
    if not (n >= 1 and 0 <= k <= n):
        raise InvalidValue("k of n", f"{k} of {n} is no share.", "Count at least one trial.")


def wilson(k: int, n: int) -> Interval:
    """Return the two-sided score interval (Wilson 1927, J. Am. Stat. Assoc. 22, 209–212).

    It holds all p at which k is at most `Z` standard deviations from n·p; its ends solve
    (k − n·p)² = Z²·n·p·(1 − p). Averaged over p it contains the true p in 95 % of cases. At worst,
    near n·p = 0.17, it does so in 84 %, since its lower end is a little high after a single event.
    """
    centre = (k + Z**2 / 2.0) / (n + Z**2)
    half_width = Z / (n + Z**2) * sqrt(k * (n - k) / n + Z**2 / 4.0)
    return Interval(max(0.0, centre - half_width), min(1.0, centre + half_width))


def find_lower_bound(k: int, n: int, error: float) -> float:
    """Return the p at which k or more events in n trials have the probability `error`.

    Exact (Clopper and Pearson 1934, Biometrika 26, 404–413); 0 without an event.
    """
    if k == n:
        return float(error ** (1.0 / n))
    return (
        find_crossing(0.0, 1.0, lambda p: 1.0 - sum_lower_tail(k - 1, n, p) < error) if k else 0.0
    )


def find_upper_bound(k: int, n: int, error: float) -> float:
    """Return the p at which k or fewer events in n trials have the probability `error`.

    Exact (Clopper and Pearson 1934); near 3 / n without an event and with an error of 5 %.
    """
    if k == 0:
        return float(1.0 - error ** (1.0 / n))
    return find_crossing(0.0, 1.0, lambda p: sum_lower_tail(k, n, p) > error) if k < n else 1.0


REACH = 20.0
"""Standard deviations from the mean beyond which a binomial distribution has no weight."""


def sum_lower_tail(k: int, n: int, p: float) -> float:
    """Return the probability of k or fewer events in n trials, for 0 < p < 1."""
    mean = n * p
    reach = REACH * sqrt(mean * (1.0 - p)) + 2.0 * REACH
    if k > mean + reach:
        return 1.0
    ways = lgamma(n + 1.0) - lgamma(k + 1.0) - lgamma(n - k + 1.0)
    term = exp(ways + k * log(p) + (n - k) * log1p(-p)) if k >= 0 else 0.0
    total = 0.0
    for events in range(k, max(int(mean - reach), 0) - 1, -1):
        total += term
        # P(events − 1) ÷ P(events): one logarithm of factorials is enough for the whole sum.
        term *= events / (n - events + 1.0) * (1.0 - p) / p
    return min(total, 1.0)


def find_crossing(low: float, high: float, is_below: Callable[[float], bool]) -> float:
    """Return the point at which a condition that holds at the low end stops holding."""
    for _ in range(HALVINGS):
        middle = (low + high) / 2.0
        low, high = (middle, high) if is_below(middle) else (low, middle)
    return high


def difference(a: Rate, b: Rate) -> Difference:
    """Return the difference of two rates, b − a, with its 95 % interval, for independent samples.

    It is Newcombe's hybrid score interval, computed from the estimates p and Wilson's intervals
    (l, u) of both rates. With d = p_b − p_a, it goes from
    d − sqrt((p_b − l_b)² + (u_a − p_a)²) to d + sqrt((u_b − p_b)² + (p_a − l_a)²).
    For paired samples see `paired_difference`.
    Source: Newcombe 1998, Statistics in Medicine 17, 873–890, method 10; with other intervals:
    Zou and Donner 2008, Statistics in Medicine 27, 1693–1702.

    Args:
        a: rate with a two-sided interval; without an estimate, its share of events is used.
        b: second rate, like `a`.

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


def mcnemar(pairs: PairTotals) -> McNemar:
    """Return McNemar's exact test, which uses only pairs with a failure on exactly one side.

    If both sides were equally prone to fail, each side would be the failed one with probability
    1/2. The p-value is twice the binomial tail of the rarer case, at most 1. Source: McNemar 1947,
    Psychometrika 12, 153–157.
    """
    rarer = min(pairs.only_first, pairs.only_second)
    tail = sum_lower_tail(rarer, pairs.only_first + pairs.only_second, 0.5)
    return McNemar(
        n=pairs.n,
        both=pairs.both,
        only_a=pairs.only_first,
        only_b=pairs.only_second,
        neither=pairs.neither,
        p_value=min(1.0, 2.0 * tail),
    )


def paired_difference(pairs: PairTotals) -> Difference:
    """Return the rate of the second side minus the first side's rate, for paired samples.

    The interval is Tango's score interval of 95 %. It holds all differences d at which
    (b − c − n·d)² is at most Z² · n · (2·q + d·(1 − d)). In b pairs only the second side failed,
    in c pairs only the first side failed. The likeliest probability of such a c pair at this d is
    q. It is the root of 2n·q² + ((2n − b + c)·d − b − c)·q − c·d·(1 − d) = 0. The interval excludes
    0 if and only if McNemar's test without correction has p < 0.05: (b − c)² > Z² · (b + c).
    Source: Tango 1998, Statistics in Medicine 17, 891–908; recommended by Newcombe 1998, Statistics
    in Medicine 17, 2635–2650.

    Raises:
        InvalidValue: no pair.
    """
    n, more, fewer = pairs.n, pairs.only_second, pairs.only_first
    refuse_no_share(more, n)
    value = (more - fewer) / n

    def is_above(at: float) -> bool:
        return _score_pairs(more, fewer, n, at) > Z

    def is_not_below(at: float) -> bool:
        return _score_pairs(more, fewer, n, at) >= -Z

    bounds = Interval(find_crossing(-1.0, value, is_above), find_crossing(value, 1.0, is_not_below))
    return Difference(value, bounds, n, n, is_paired=True)


def _score_pairs(more: int, fewer: int, n: int, at: float) -> float:
    """Return the observed difference minus a given one, in standard deviations."""
    away = more - fewer - n * at
    half = ((2 * n - more + fewer) * at - more - fewer) / 2.0
    # Rounding may lead a little below 0, here and in the next line.
    root = sqrt(max(half * half + 2.0 * n * fewer * at * (1.0 - at), 0.0))
    rarer = max(root - half, 0.0) / (2.0 * n)
    variance = n * (2.0 * rarer + at * (1.0 - at))
    if variance <= 0.0:
        return inf if away > 0.0 else -inf if away < 0.0 else 0.0
    return away / sqrt(variance)


def _place_rate(rate: Rate) -> tuple[float, float, float]:
    """Return the estimate of a rate, clipped to its interval, and both ends of the interval."""
    bounds = rate.interval or Interval(0.0, 1.0)
    value = rate.share if rate.value is None else rate.value
    # An estimate without bias may lie a little outside of its interval.
    return min(max(value, bounds.low), bounds.high), bounds.low, bounds.high
