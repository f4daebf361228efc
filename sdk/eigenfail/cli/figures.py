"""Figures as people read them; what is not known is a dash, never a zero."""

from math import floor, isfinite, log10

from eigenfail.values import Cost, Estimate, Rate

UNKNOWN = "–"


def number(value: float | None, digits: int = 2) -> str:
    """With a fixed number of decimals."""
    return UNKNOWN if value is None or not isfinite(value) else f"{value:.{digits}f}"


def count(value: int | None) -> str:
    """A count, if there is one."""
    return UNKNOWN if value is None else str(value)


def usd(value: float | None) -> str:
    """With at least two decimals and at least two significant digits."""
    if value is None or not isfinite(value):
        return UNKNOWN
    digits = 2 if value <= 0.0 else max(2, 1 - floor(log10(value)))
    return f"{value:.{digits}f}"


def rate(value: Rate | None) -> str:
    """A share in percent with its 95 % interval; of no event, its upper bound, near 3 / n."""
    if value is None:
        return UNKNOWN
    if value.k == 0:
        return f"≤ {100.0 * value.interval.high:.2g} % (0 of {value.n})"
    share, low, high = (100.0 * x for x in (value.value, value.interval.low, value.interval.high))
    return f"{share:.1f} % [{low:.1f}, {high:.1f}]"


def probability(estimate: Estimate | None) -> str:
    """With its 95 % interval and the number of episodes; a dash where none is told."""
    if estimate is None or estimate.probability is None or estimate.interval is None:
        return UNKNOWN
    bounds = f"[{estimate.interval.low:.1e}, {estimate.interval.high:.1e}]"
    return f"{estimate.probability:.1e} {bounds} (n = {estimate.episodes})"


def cost_per_failure(cost: Cost) -> str:
    """In USD with its 95 % interval; only the lower bound while there is no failure."""
    if cost.per_failure_usd is None:
        return UNKNOWN if cost.at_least_usd is None else f"≥ {usd(cost.at_least_usd)}"
    if cost.interval_usd is None:
        return usd(cost.per_failure_usd)
    bounds = f"{usd(cost.interval_usd.low)}, {usd(cost.interval_usd.high)}"
    return f"{usd(cost.per_failure_usd)} [{bounds}]"
