"""Mean, VaR and CVaR of a sample (Rockafellar and Uryasev 2000, Journal of Risk 2, 21–41)."""

from math import ceil, sqrt

import numpy as np
from numpy.typing import NDArray

from eigenfail.errors import InvalidValue
from eigenfail.intervals import ERROR
from eigenfail.values.estimates import Interval
from eigenfail.values.safety import Figure, SeverityRisk

Array = NDArray[np.float64]

LEAST_BEYOND = 5
"""Minimum number of values above VaR for which VaR and CVaR are given."""

LEAST_FOR_INTERVAL = 15
"""Minimum number of values above VaR for an interval: of normal, uniform, exponential and
log-normal samples the bootstrap's 95 % interval of CVaR held the truth in 52 to 76 % of cases with
2 or 3 above VaR, 78 to 86 % with 5, 86 to 91 % with 10, 88 % with 15 and 91 to 94 % with 20."""

RESAMPLES = 1_000
SEED = 0
# n · level is a product of doubles: 100 · 0.07 is 7.000000000000001, whose ceiling is 8.
ROUNDING = 1e-9


def tail_risk(values: Array, level: float) -> SeverityRisk:
    """Return mean, VaR and CVaR of the values, with intervals.

    VaR and CVaR refer to the empirical distribution. VaR is the smallest value x with F(x) ≥ level.
    CVaR = VaR + Σ max(xᵢ − VaR, 0) ÷ ((1 − level)·n) (equation 10 of the paper, at its minimum).
    The interval of the mean is Student's. The intervals of VaR and CVaR are percentiles of a seeded
    bootstrap.

    Args:
        values: finite, non-negative values in any order, shape (n,).
        level: between 0 and 1, both excluded.

    Raises:
        InvalidValue: the level is not between 0 and 1.
    """
    if not 0.0 < level < 1.0:
        raise InvalidValue("level", f"{level} is not between 0 and 1.", "Take 0.95.")
    n, beyond = len(values), len(values) * (1.0 - level)
    risk = SeverityRisk(level=level, n=n, beyond=beyond)
    if n == 0:
        return SeverityRisk(level=level, n=0, beyond=0.0, problem="There is no failure.")
    ordered = np.sort(values)
    middle = _estimate_mean(ordered)
    if beyond < LEAST_BEYOND - ROUNDING:
        problem = _explain_too_few(risk, LEAST_BEYOND, "VaR and CVaR")
        return SeverityRisk(level=level, n=n, beyond=beyond, mean=middle, problem=problem)
    var, cvar = measure_tail(ordered, level)
    has_interval = beyond >= LEAST_FOR_INTERVAL - ROUNDING
    spread = bootstrap_intervals(ordered, level) if has_interval else (None, None)
    return SeverityRisk(
        level=level,
        n=n,
        beyond=beyond,
        mean=middle,
        var=Figure(var, spread[0]),
        cvar=Figure(cvar, spread[1]),
        problem=""
        if has_interval
        else _explain_too_few(risk, LEAST_FOR_INTERVAL, "their intervals"),
    )


def _estimate_mean(values: Array) -> Figure:
    """Return the mean of values, shape (n,), with Student's 95 % interval (cut at 0) if n > 1."""
    from scipy.special import stdtrit  # the API starts sooner without it

    n, centre = len(values), float(values.mean())
    if n < 2:
        return Figure(centre)
    error = float(stdtrit(n - 1, 1.0 - ERROR / 2.0)) * float(values.std(ddof=1)) / sqrt(n)
    return Figure(centre, Interval(max(centre - error, 0.0), centre + error))


def _find_rank(n: int, level: float) -> int:
    """Return the rank of VaR among n ascending values, from 1."""
    return max(1, ceil(n * level - ROUNDING))


def measure_tail(ordered: Array, level: float) -> tuple[float, float]:
    """Return VaR and CVaR of ascending values, shape (n,)."""
    n, k = len(ordered), _find_rank(len(ordered), level)
    var = float(ordered[k - 1])
    return var, var + float((ordered[k:] - var).sum()) / ((1.0 - level) * n)


def bootstrap_intervals(ordered: Array, level: float) -> tuple[Interval, Interval]:
    """Return percentile intervals of VaR and CVaR over resamples of ascending values, shape (n,).

    A resample of n values is x[⌊n·u⌋] for n uniform numbers u. Only the k-th smallest number and
    larger ones count. The k-th smallest number is distributed as Beta(k, n − k + 1). Given this
    number, the larger ones are uniform between it and 1. So a resample is exact, and costs only as
    many draws as there are values beyond VaR.
    """
    n, k = len(ordered), _find_rank(len(ordered), level)
    random = np.random.default_rng(SEED)
    # The k-th smallest of n uniform numbers.
    cuts = random.beta(k, n - k + 1, RESAMPLES)
    drawn = (measure_resample(ordered, cut, n - k, level, random) for cut in cuts)
    found = np.array(list(drawn))
    low, high = np.quantile(found, [ERROR / 2.0, 1.0 - ERROR / 2.0], axis=0)
    var, cvar = (Interval(float(a), float(b)) for a, b in zip(low, high, strict=True))
    return var, cvar


def measure_resample(
    ordered: Array, cut: float, above: int, level: float, random: np.random.Generator
) -> tuple[float, float]:
    """Return VaR and CVaR of one resample with `above` values above the quantile `cut`."""
    n = len(ordered)
    var = float(ordered[min(int(n * cut), n - 1)])
    places = (n * (cut + (1.0 - cut) * random.random(above))).astype(np.intp)
    excess = float((ordered[np.minimum(places, n - 1)] - var).sum())
    return var, var + excess / ((1.0 - level) * n)


def _explain_too_few(risk: SeverityRisk, least: int, what: str) -> str:
    """Return why the values are too few, with a remedy."""
    needed = ceil(least / (1.0 - risk.level) - ROUNDING)
    leave = "failure leaves" if risk.n == 1 else "failures leave"
    return (
        f"{what} at {100.0 * risk.level:g} % need at least {least} failures above that quantile, "
        f"hence {needed} failures in all; {risk.n} {leave} {risk.beyond:.3g}. Run more episodes, "
        "or take a lower level."
    )
