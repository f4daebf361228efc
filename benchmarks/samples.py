"""Figures from samples, with their 95 % intervals."""

from collections.abc import Sequence
from math import sqrt
from statistics import fmean, stdev
from statistics import median as middle

import msgspec
from benchmarks.figures import Figure

from eigenfail.intervals import Z, find_interval

COMMAND = "python -m benchmarks.claims"


def share(happened: Sequence[bool], note: str = "") -> Figure:
    """How often something happened; Wilson's interval."""
    k, n = sum(happened), len(happened)
    found = find_interval(k, n)
    ends = (found.low, found.high)
    return Figure(value=k / n, unit="share", n=n, interval=ends, note=note, command=COMMAND)


def count_share(happened: Sequence[bool], note: str = "") -> Figure:
    """How often something happened in an enumeration, which is no sample: without interval."""
    return msgspec.structs.replace(share(happened, note), interval=None)


def mean(values: Sequence[float], unit: str, note: str = "") -> Figure:
    """The mean; a normal interval, where there are two values at least."""
    if not values:
        return Figure(value=None, unit=unit, n=0, note=note, command=COMMAND)
    centre, ends = fmean(values), None
    if len(values) > 1:
        half_width = Z * stdev(values) / sqrt(len(values))
        ends = (centre - half_width, centre + half_width)
    return Figure(value=centre, unit=unit, n=len(values), interval=ends, note=note, command=COMMAND)


def median(values: Sequence[float], unit: str, note: str = "") -> Figure:
    """The median; its interval by order statistics, normal approximation of their ranks."""
    ordered, n = sorted(values), len(values)
    if not ordered:
        return Figure(value=None, unit=unit, n=0, note=note, command=COMMAND)
    reach = Z * sqrt(n) / 2.0
    low, high = max(int(n / 2 - reach), 0), min(int(n / 2 + reach) + 1, n - 1)
    return Figure(
        value=middle(ordered),
        unit=unit,
        n=n,
        interval=(ordered[low], ordered[high]),
        note=note,
        command=COMMAND,
    )
