"""Figures as people read them; units stand beside them, never inside a table of numbers."""

import re

from eigenfail.values import Cost, Interval, Rate
from eigenfail_services.reports.formats import NONE, bounds, integer, moment, number, percent

__all__ = [
    "NONE",
    "cost_per_failure",
    "counted",
    "duration",
    "integer",
    "interval",
    "moment",
    "number",
    "percent",
    "rate_interval",
    "signed",
]

DURATIONS = ((86_400, "d"), (3_600, "h"), (60, "min"), (1, "s"))

NEGATIVE = re.compile(r"(?<![\w.)])-(?=\d)")
"""A hyphen that stands for a minus: neither in a word nor in a range."""


def counted(count: int, noun: str) -> str:
    """So many of a thing: 1 failure, 2 failures."""
    return f"{integer(count)} {noun}{'' if count == 1 else 's'}"


def signed(sentence: str) -> str:
    """A sentence that came with its figures, negative ones as they are written here."""
    return NEGATIVE.sub("−", sentence)


def rate_interval(rate: Rate) -> str:
    """The 95 % interval of a rate, in percent."""
    return f"{bounds(rate.interval, 100.0)} %"


def interval(of: Interval) -> str:
    """From low to high."""
    return bounds(of)


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
