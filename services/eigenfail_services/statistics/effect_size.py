"""How much higher one group's values are than another's, whatever their distribution."""

from collections.abc import Sequence

from eigenfail.errors import InvalidValue
from eigenfail.values import EffectSize, Magnitude

LEAST = 2
"""Values on each side: of a single one nothing can be said about how values spread."""

THRESHOLDS = (
    (0.21, Magnitude.LARGE),
    (0.14, Magnitude.MEDIUM),
    (0.06, Magnitude.SMALL),
)
"""|A12 − 1/2| from which on an effect is called so."""

ROUNDING = 1e-9


def effect_size(a: Sequence[float], b: Sequence[float]) -> EffectSize:
    """A12 of b over a: P(b > a) + P(b = a) / 2 for a value of each, drawn at random.

    Source: Vargha and Delaney 2000, Journal of Educational and Behavioral Statistics 25, 101–132.

    Raises:
        InvalidValue: fewer than two values on a side.
    """
    if min(len(a), len(b)) < LEAST:
        problem = f"{len(a)} and {len(b)} values have no effect size."
        raise InvalidValue("values", problem, f"Give at least {LEAST} on each side.")
    wins = sum((y > x) + (y == x) / 2.0 for x in a for y in b)
    a12 = wins / (len(a) * len(b))
    return EffectSize(a12, magnitude(a12), len(a), len(b))


def magnitude(a12: float) -> Magnitude:
    """What an effect of this size is called."""
    away = abs(a12 - 0.5) + ROUNDING
    return next((name for least, name in THRESHOLDS if away >= least), Magnitude.NEGLIGIBLE)
