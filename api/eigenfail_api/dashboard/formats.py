"""Figures as people read them; units stand beside them, never inside a table of numbers."""

from datetime import UTC, datetime
from math import floor, isfinite, log10

from eigenfail.values import Cost, Interval, Rate

NONE = "–"
DIGITS = 3
LARGEST_PLAIN = 1e6
SMALLEST_PLAIN = 1e-3
SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
DURATIONS = ((86_400, "d"), (3_600, "h"), (60, "min"), (1, "s"))


def integer(value: int) -> str:
    """A count, its thousands apart."""
    return f"{value:,}"


def number(value: float | None, digits: int = DIGITS) -> str:
    """A figure with so many significant digits; a dash for none."""
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


def percent(share: float | None) -> str:
    """A share of one in percent."""
    return NONE if share is None else f"{number(100.0 * share)} %"


def rate_interval(rate: Rate) -> str:
    """The 95 % interval of a rate, in percent."""
    return f"{number(100.0 * rate.interval.low)} – {number(100.0 * rate.interval.high)} %"


def interval(bounds: Interval) -> str:
    """From low to high."""
    return f"{number(bounds.low)} – {number(bounds.high)}"


def cost_per_failure(cost: Cost) -> str:
    """USD for each failure, or what one costs at least while there is none."""
    if cost.per_failure_usd is not None:
        return f"{number(cost.per_failure_usd)} USD"
    return NONE if cost.at_least_usd is None else f"≥ {number(cost.at_least_usd)} USD"


def duration(seconds: float | None) -> str:
    """Two units are enough: 3 min 12 s."""
    if seconds is None:
        return NONE
    if seconds < 1.0:
        return f"{number(seconds, 2)} s"
    left, words = round(seconds), list[str]()
    for size, unit in DURATIONS:
        count, left = divmod(left, size)
        if count or (words and unit != "s"):
            words.append(f"{count} {unit}")
    return " ".join(words[:2])


def moment(at_ms: int | None) -> str:
    """A time in UTC, as the stored times are: no reader's clock can shift it."""
    if at_ms is None:
        return NONE
    return datetime.fromtimestamp(at_ms / 1000.0, UTC).strftime("%Y-%m-%d %H:%M:%S UTC")
