"""Figures as people read them; what is not known is a dash, never a zero."""

from datetime import UTC, datetime
from math import floor, isfinite, log10

from eigenfail.values import Cost, Estimate, Interval, Rate
from eigenfail.values.report import Cell

NONE = "–"
DIGITS = 3
LARGEST_PLAIN = 1e6
SMALLEST_PLAIN = 1e-3
SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
NOTHING_YET = "no episode completed"

Lines = tuple[str, ...]
"""A figure, and below it what it rests on."""


def integer(value: int) -> str:
    """A count, its thousands apart."""
    return f"{value:,}"


def number(value: float | None, digits: int = DIGITS) -> str:
    """A figure with so many significant digits."""
    if value is None or not isfinite(value):
        return NONE
    if value == 0.0:
        return "0"
    if not SMALLEST_PLAIN <= abs(value) < LARGEST_PLAIN:
        mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
        raised = str(int(exponent)).translate(SUPERSCRIPTS)
        return f"{mantissa}×10{raised}".replace("-", "−")
    decimals = max(0, digits - 1 - floor(log10(abs(value))))
    return f"{value:,.{decimals}f}".replace("-", "−")


def usd(amount: float | None) -> str:
    """Money with three significant digits and at least two decimals, never as a power of ten."""
    if amount is None or not isfinite(amount):
        return NONE
    digits = 2 if amount <= 0.0 else max(2, DIGITS - 1 - floor(log10(amount)))
    return f"{amount:,.{digits}f} USD"


def percent(share: float | None) -> str:
    """A share of one in percent."""
    return NONE if share is None else f"{number(100.0 * share)} %"


def bounds(interval: Interval, factor: float = 1.0) -> str:
    """From low to high."""
    return f"{number(factor * interval.low)} – {number(factor * interval.high)}"


def cell(value: Cell, unit: str = "") -> str:
    """A cell of a table of numbers."""
    if isinstance(value, bool):
        return "yes" if value else "no"
    if isinstance(value, float):
        return percent(value) if unit == "share" else number(value, 4)
    return NONE if value is None else str(value)


def rate(found: Rate | None) -> Lines:
    """A failure rate with its interval; of no failure, its upper bound."""
    if found is None:
        return (NONE, NOTHING_YET)
    if not found.k:
        return (f"≤ {percent(found.interval.high)}", "95 % upper bound; none found")
    return (percent(found.value), f"95 %: {bounds(found.interval, 100.0)} %")


def cost_per_failure(cost: Cost) -> Lines:
    """USD for each failure with its interval, or what one costs at least while there is none."""
    if cost.per_failure_usd is not None and cost.interval_usd is not None:
        low, high = usd(cost.interval_usd.low), usd(cost.interval_usd.high)
        return (usd(cost.per_failure_usd), f"95 %: {low.removesuffix(' USD')} – {high}")
    if cost.at_least_usd is not None:
        return (f"≥ {usd(cost.at_least_usd)}", "95 % lower bound; none found")
    return (NONE, NOTHING_YET)


def probability(estimate: Estimate | None) -> Lines:
    """Of a failure under p(x) with its interval, or why it is not told."""
    if estimate is None:
        return (NONE, "this method tells none")
    if estimate.probability is None or estimate.interval is None:
        return ("not told", estimate.problem, f"by {estimate.by}")
    basis = f"by {estimate.by}, n = {integer(estimate.episodes)}, cv {number(estimate.cv)}"
    found = (number(estimate.probability), f"95 %: {bounds(estimate.interval)}", basis)
    return (*found, *([estimate.note] if estimate.note else []))


def moment(at_ms: int | None) -> str:
    """A time in UTC, as the stored times are."""
    if at_ms is None:
        return NONE
    return datetime.fromtimestamp(at_ms / 1000.0, UTC).strftime("%Y-%m-%d %H:%M:%S UTC")
