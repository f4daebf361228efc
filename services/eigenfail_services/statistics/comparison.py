"""Comparisons of two samples: effect sizes, rank correlation."""

from collections.abc import Sequence
from math import atanh, comb, sqrt, tanh

import numpy as np
from numpy.typing import NDArray

from eigenfail.errors import InvalidValue
from eigenfail.intervals import Z
from eigenfail.values.comparison import EffectSize, Magnitude
from eigenfail.values.estimates import Interval
from eigenfail.values.safety import Figure

SIGNIFICANCE = 0.05


def can_distinguish(n_a: int, n_b: int) -> bool:
    """Return whether n_a and n_b values could show a significant difference if fully separated.

    The smallest p-value of the exact rank-sum test is 2 ÷ (n_a + n_b over n_a) (Mann and Whitney
    1947, Annals of Mathematical Statistics 18, 50–60). It is 0.33 with two values on each side, 0.1
    with three, and 0.029 with four.
    """
    return 2.0 / comb(n_a + n_b, n_a) <= SIGNIFICANCE


# A12 of 0.71, 0.64 and 0.56 (Vargha and Delaney 2000).
THRESHOLDS = (
    (0.21, Magnitude.LARGE),
    (0.14, Magnitude.MEDIUM),
    (0.06, Magnitude.SMALL),
)
"""Least |A12 − 1/2| of an effect of each magnitude."""

# In doubles 0.71 − 0.5 is a little less than 0.21, and would fall below its threshold.
EFFECT_ROUNDING = 1e-9


def effect_size(a: Sequence[float], b: Sequence[float]) -> EffectSize:
    """Return A12 of b over a: P(b > a) + P(b = a) / 2 for random values of a and b.

    Source: Vargha and Delaney 2000, Journal of Educational and Behavioral Statistics 25, 101–132.

    Raises:
        InvalidValue: with so few values, chance could separate them completely.
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
        None for fewer than ten pairs, or if one variable is constant.
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
