"""The formatter of numbers, the same on terminal, page, report and notebook.

A measured number has three significant digits. Between 0.001 and 1,000,000 it is written without a
power of ten; larger numbers keep all digits before the point. A half is rounded away from zero. A
share is in percent with three significant digits (34.3 %, 4.17 %, 0.125 %). An amount of money has
three significant digits and at least two decimals, and never a power of ten. A count is exact, with
its thousands apart. A 95 % interval is in brackets; each end has the digits of a number. Its ends
and other bounds are rounded outwards, so that the printed interval contains the computed one. An
unknown value is a dash, never a zero. Programs read JSON, CSV and the REST API, which hold the
numbers unrounded.
"""

import re
from datetime import UTC, datetime
from decimal import ROUND_CEILING, ROUND_FLOOR, ROUND_HALF_UP, Decimal
from math import floor, isfinite, log10
from typing import Protocol

UNKNOWN = "–"
DIGITS = 3
LARGEST_PLAIN = 1e6
SMALLEST_PLAIN = 1e-3

_SUPERSCRIPTS = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_DURATIONS = ((86_400, "d"), (3_600, "h"), (60, "min"), (1, "s"))
_TIME = "%Y-%m-%d %H:%M:%S"
_HYPHEN_BEFORE_NUMBER = re.compile(r"(?<![\w.)])-(?=\d)")
"""A hyphen that stands for a minus: neither in a word nor in a range."""


class Bounds(Protocol):
    """An interval from low to high."""

    @property
    def low(self) -> float:
        """The lower end."""

    @property
    def high(self) -> float:
        """The upper end."""


def format_count(value: int | None) -> str:
    """Return a count with separated thousands."""
    return UNKNOWN if value is None else f"{value:,}"


def format_number(value: float | None, digits: int = DIGITS) -> str:
    """Return a number with this many significant digits."""
    if value is None or not isfinite(value):
        return UNKNOWN
    if value == 0.0:
        return "0"
    # The first rounding may carry into another power of ten: 0.9996 has the digits of 1. Python's
    # own formats round a half to the even digit, which turns 36.25 into 36.2.
    rounded = _round(value, digits, ROUND_HALF_UP)
    if not SMALLEST_PLAIN <= abs(rounded) < LARGEST_PLAIN:
        mantissa, exponent = f"{rounded:.{digits - 1}e}".split("e")
        raised = str(int(exponent)).translate(_SUPERSCRIPTS)
        return f"{mantissa}×10{raised}".replace("-", "−")
    decimals = max(0, digits - 1 - floor(log10(abs(rounded))))
    printed = _read_exact(value).quantize(Decimal(1).scaleb(-decimals), ROUND_HALF_UP)
    return f"{printed:,f}".replace("-", "−")


def format_signed(value: float | None, digits: int = DIGITS) -> str:
    """Return a number with its sign, also if it is positive."""
    text = format_number(value, digits)
    return f"+{text}" if value is not None and isfinite(value) and value > 0.0 else text


def format_share(share: float | None, digits: int = DIGITS) -> str:
    """Return a share of one in percent."""
    known = share is not None and isfinite(share)
    return f"{format_number(100.0 * share, digits)} %" if known and share is not None else UNKNOWN


def format_usd(amount: float | None) -> str:
    """Return an amount of money without its unit."""
    if amount is None or not isfinite(amount):
        return UNKNOWN
    decimals = 2 if amount <= 0.0 else max(2, DIGITS - 1 - floor(log10(amount)))
    return f"{amount:,.{decimals}f}"


def format_money(amount: float | None) -> str:
    """Return an amount of money with its unit."""
    return put_unit(format_usd(amount), "USD")


def format_quantity(value: float | None, unit: str) -> str:
    """Return a number with its unit, or a dash."""
    return put_unit(format_number(value), unit)


def put_unit(text: str, unit: str) -> str:
    """Return a formatted number with its unit, or a dash."""
    return text if text == UNKNOWN else f"{text} {unit}"


def round_down(value: float, digits: int = DIGITS) -> float:
    """Return the largest number with `digits` significant digits that is not above the value."""
    return _round(value, digits, ROUND_FLOOR)


def round_up(value: float, digits: int = DIGITS) -> float:
    """Return the smallest number with `digits` significant digits that is not below the value."""
    return _round(value, digits, ROUND_CEILING)


def _round(value: float, digits: int, rounding: str) -> float:
    if not isfinite(value) or value == 0.0:
        return value
    exact = _read_exact(value)
    return float(exact.quantize(Decimal(1).scaleb(exact.adjusted() - digits + 1), rounding))


def _read_exact(value: float) -> Decimal:
    # Digits beyond the twelfth are the error of floats: 100 * 0.07 is 7.000000000000001.
    return Decimal(f"{value:.11e}")


def format_upper_bound(share: float) -> str:
    """Return an upper bound of a share in percent, such as ≤ 0.150 %."""
    return f"≤ {format_share(round_up(share))}"


def format_percent_interval(interval: Bounds) -> str:
    """Return the interval of a share in percent."""
    return f"{format_interval(interval, 100.0)} %"


def format_interval(interval: Bounds, factor: float = 1.0) -> str:
    """Return an interval in brackets, rounded outwards, with its ends multiplied by the factor."""
    low, high = round_down(factor * interval.low), round_up(factor * interval.high)
    return f"[{format_number(low)}, {format_number(high)}]"


def format_signed_interval(interval: Bounds, factor: float = 1.0) -> str:
    """Return an interval of a difference in brackets, rounded outwards, with signs."""
    low, high = round_down(factor * interval.low), round_up(factor * interval.high)
    return f"[{format_signed(low)}, {format_signed(high)}]"


def format_usd_interval(interval: Bounds) -> str:
    """Return an interval of an amount of money in brackets, rounded outwards at its last digit."""
    low = round_down(interval.low, _count_usd_digits(interval.low))
    high = round_up(interval.high, _count_usd_digits(interval.high))
    return f"[{format_usd(low)}, {format_usd(high)}]"


def _count_usd_digits(amount: float) -> int:
    """Return the number of significant digits for printing an amount, cents included."""
    return DIGITS if amount <= 0.0 else max(DIGITS, floor(log10(amount)) + 3)


def format_duration(seconds: float | None) -> str:
    """Return a duration in its two largest units, such as 3 min 12 s."""
    if seconds is None:
        return UNKNOWN
    if seconds < 1.0:
        return f"{format_number(seconds)} s"
    left, words = round(seconds), list[str]()
    for size, unit in _DURATIONS:
        count, left = divmod(left, size)
        if count or (words and unit != "s"):
            words.append(f"{count} {unit}")
    return " ".join(words[:2])


def format_local_time(at_ms: int | None) -> str:
    """Return a time in the zone of the reader, from milliseconds since 1970."""
    return UNKNOWN if at_ms is None else _read_time(at_ms).astimezone().strftime(_TIME)


def format_utc(at_ms: int | None) -> str:
    """Return a time in UTC, for readers in several time zones."""
    return UNKNOWN if at_ms is None else f"{_read_time(at_ms).strftime(_TIME)} UTC"


def _read_time(at_ms: int) -> datetime:
    return datetime.fromtimestamp(at_ms / 1_000, UTC)


def count_noun(count: int, noun: str) -> str:
    """Return a count with its noun: 1 failure, 2 failures."""
    return f"{format_count(count)} {noun}{'' if count == 1 else 's'}"


def put_minus_signs(sentence: str) -> str:
    """Return a sentence with minus signs for the hyphens before its numbers."""
    return _HYPHEN_BEFORE_NUMBER.sub("−", sentence)
