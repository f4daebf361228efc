"""Whether one thing rises or falls with another: Spearman's ρ."""

from math import atanh, sqrt, tanh

import numpy as np
from numpy.typing import NDArray

from eigenfail.values import Figure, Interval
from eigenfail_services.statistics.intervals import Z

Array = NDArray[np.float64]

LEAST = 10


def rank_correlation(one: Array, other: Array) -> Figure | None:
    """Spearman's ρ, the correlation of ranks, equal values sharing their mean rank.

    The interval is tanh(atanh ρ ± Z·√((1 + ρ²/2) ÷ (n − 3))) (Bonett and Wright 2000,
    Psychometrika 65, 23–28).

    Args:
        one: shape (n,).
        other: shape (n,).

    Returns:
        None over fewer than ten pairs, or where one of them does not vary.
    """
    ranks = [midranks(values) for values in (one, other)]
    if len(one) < LEAST or any(np.ptp(each) == 0.0 for each in ranks):
        return None
    rho = min(max(float(np.corrcoef(ranks[0], ranks[1])[0, 1]), -1.0), 1.0)
    if abs(rho) >= 1.0:
        return Figure(rho, Interval(rho, rho))
    error = Z * sqrt((1.0 + rho * rho / 2.0) / (len(one) - 3))
    return Figure(rho, Interval(tanh(atanh(rho) - error), tanh(atanh(rho) + error)))


def midranks(values: Array) -> Array:
    """The ranks from 1 on, in the shape of the values, (n,); equal ones share their mean rank."""
    _, places, counts = np.unique(values, return_inverse=True, return_counts=True)
    last = np.cumsum(counts)
    middle: Array = (2 * last - counts + 1) / 2.0
    return middle[places]
