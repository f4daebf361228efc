"""Trials that ended with their k-th event: unbiased estimate and exact interval.

Trials run in rounds, and a rule looks at the number of events after each round. If the next round
of a campaign is already open, it is completed. So the trials have up to three parts. After the
`early` trials, there were fewer than k events. After the `deciding` trials, there were at least k.
The `late` trials ran afterwards. With rounds of one trial and without late trials, this is inverse
sampling (Haldane 1945, Biometrika 33, 222–225).
"""

from collections.abc import Callable
from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from eigenfail.intervals import ERROR
from eigenfail.values.estimates import Interval, Rate
from eigenfail_services.statistics.intervals import clopper_pearson

Array = NDArray[np.float64]

BISECTIONS = 60


class StoppedTrials(NamedTuple):
    """The end of trials under the rule that k events end them.

    Attributes:
        limit: number of events that ends the trials.
        early: number of trials up to the last look at which the rule did not hold; 0 if the first
            look ended the trials, or without looks.
        deciding: number of trials between this look and the look at which the rule held; 0 if it
            never held, so that the budget ended the trials.
        late: number of trials after the last look of the rule.
    """

    limit: int
    early: int
    deciding: int
    late: int

    @property
    def trials(self) -> int:
        """Number of all trials."""
        return self.early + self.deciding + self.late

    def allows_doubt(self, found: Rate) -> bool:
        """Return whether the bounds hold although some trials may be additional events.

        They hold without doubtful trials. They also hold if the rule did not hold, since the budget
        then sets the number of trials. Otherwise, doubtful trials might have ended the trials
        earlier, and exact bounds are unknown.
        """
        return found.k < self.limit or not found.errored + found.unresolved

    def estimate(self, events: int) -> float | None:
        """Return the unbiased estimate of the probability of an event.

        It is the probability that the first trial was an event, given the end of the trials. That
        is the share, among all sequences with this end, of sequences that begin with an event
        (Girshick, Mosteller and Savage 1946, Annals of Mathematical Statistics 17, 13–23). With
        rounds of one trial, it is (k − 1) ÷ (n − 1). If the budget ended the trials before the k-th
        event, it is the plain share. Averaged over all ends, ends by the budget included, it equals
        the probability exactly.

        Returns:
            None if it is 0 although there were events, as with k = 1: unbiased estimates are then
            useless.
        """
        if events < self.limit:
            return events / self.trials
        found = _estimate(self, events)
        return found if found > 0.0 else None

    def find_bounds(self, events: int, tail: float = ERROR / 2.0) -> Interval:
        """Return the exact interval; each side misses the probability with at most `tail`.

        Ends are ordered by their stage, with earlier ends for larger probabilities, and within a
        stage by their number of events (Tsiatis, Rosner and Mehta 1984, Biometrics 40, 797–803).
        The bounds are the probabilities at which this end, or one further out, has the probability
        `tail`. With rounds of one trial, they are the quantiles of Beta(k, n − k + 1) and Beta(k, n
        − k).

        If the budget ended the trials before the k-th event, "this many events or more" includes
        all ends by the rule, and "this many or fewer" includes none of them. So the bounds are
        Clopper and Pearson's for a fixed number of trials.
        """
        if events < self.limit:
            return clopper_pearson(events, self.trials)
        return _find_bounds(self, events, tail)


@lru_cache(4096)
def _estimate(end: StoppedTrials, events: int) -> float:
    # The weights of sequences with the same number of events do not depend on p; at this one the
    # largest of them can be represented.
    p = events / end.trials
    if p >= 1.0:
        return 1.0
    if not end.early:  # the first trial is one of the deciding ones, if there were any
        inside = np.arange(end.limit, min(end.deciding, events) + 1)
        weights = _pmf(inside, end.deciding, p) * _pmf(events - inside, end.late, p)
        return float(weights @ inside / weights.sum() / end.deciding) if end.deciding else p
    counted = _list_early(end, events)
    rest = _pmf(events - counted, end.late, p)
    if end.deciding:
        # Of each number of early events, over the events at the look that ended the trials.
        seen = np.arange(end.limit, end.limit + end.deciding)
        late = _pmf(events - seen, end.late, p)
        rest = np.convolve(late, _pmf(np.arange(end.deciding + 1), end.deciding, p)[::-1])
        rest = rest[counted - end.limit + end.deciding]
    weights = _pmf(counted, end.early, p) * rest
    return float(weights @ counted / weights.sum() / end.early)


def _list_early(end: StoppedTrials, events: int) -> NDArray[np.int64]:
    """Return the possible numbers of events in the early trials, given this end."""
    fewest = max(events - end.deciding - end.late, 0)
    return np.arange(fewest, min(end.limit - 1, end.early) + 1)


@lru_cache(4096)
def _find_bounds(end: StoppedTrials, events: int, tail: float) -> Interval:
    return Interval(
        _bisect(lambda p: _sum_end(end, events, p, upper=True) < tail),
        _bisect(lambda p: _sum_end(end, events, p, upper=False) > tail),
    )


def _bisect(is_below: Callable[[float], bool]) -> float:
    """Return the p up to which a condition holds; 0 if it never holds, 1 if it always holds."""
    low, high = 0.0, 1.0
    for _ in range(BISECTIONS):
        middle = (low + high) / 2.0
        low, high = (middle, high) if is_below(middle) else (low, middle)
    # Next to 1 the last step stays one bit short of it.
    return 1.0 if high == 1.0 else low


def _sum_end(end: StoppedTrials, events: int, p: float, *, upper: bool) -> float:
    """Return the probability of this end or of ends for larger (`upper`) or smaller p."""
    from scipy.special import bdtr, bdtrc  # imported late: the API starts sooner without it

    # With fewer early events than these, the rule would not have held at the look that ended the
    # trials, or without such a look there cannot be as many events as there were.
    fewest = max(end.limit - end.deciding if end.deciding else events - end.late, 0)
    early = np.arange(fewest, min(end.limit - 1, end.early) + 1)
    chances = _pmf(early, end.early, p)
    if upper:
        ended = float(bdtrc(end.limit - 1, end.early, p)) if end.early >= end.limit else 0.0
    else:
        looked, most = end.early, fewest - 1
        if end.deciding:
            looked, most = end.early + end.deciding, end.limit - 1
        ended = float(bdtr(most, looked, p)) if most >= 0 else 0.0
    left = events - early
    if end.deciding:
        # Events at the look that ended the trials, of sequences that went on before it.
        seen = _convolve(chances, _pmf(np.arange(end.deciding + 1), end.deciding, p))
        chances = seen[end.limit - fewest :]
        left = events - end.limit - np.arange(len(chances))
    tails = _survive(left, end.late, p) if upper else _accumulate(left, end.late, p)
    return ended + float(chances @ tails)


def _convolve(one: Array, other: Array) -> Array:
    """Return the distribution of the sum of two numbers, for rounds of any size."""
    size = len(one) + len(other) - 1
    # By Fourier transforms, which takes n log n steps for rounds of n trials.
    found: Array = np.fft.irfft(np.fft.rfft(one, size) * np.fft.rfft(other, size), size)
    return found


def _pmf(k: NDArray[np.int64], n: int, p: float) -> Array:
    """Return the probabilities of k events in n trials; 0 for an impossible k."""
    from scipy.special import gammaln, xlog1py, xlogy  # imported late, as above

    inside = (k >= 0) & (k <= n)
    known = np.where(inside, k, 0)
    ways = gammaln(n + 1.0) - gammaln(known + 1.0) - gammaln(n - known + 1.0)
    logarithm = ways + xlogy(known, p) + xlog1py(n - known, -p)
    found: Array = np.where(inside, np.exp(logarithm), 0.0)
    return found


def _accumulate(k: NDArray[np.int64], n: int, p: float) -> Array:
    """Return the probabilities of k or fewer events in n trials, also for k < 0 and k > n."""
    from scipy.special import bdtr  # imported late, as above

    inner: Array = bdtr(np.clip(k, 0, n), n, p)
    return np.where(k < 0, 0.0, np.where(k >= n, 1.0, inner))


def _survive(k: NDArray[np.int64], n: int, p: float) -> Array:
    """Return the probabilities of k or more events in n trials, also for k <= 0 and k > n."""
    found: Array = 1.0 - _accumulate(k - 1, n, p)
    return found
