"""Checks whether a log is of the disturbance model that was fitted to it."""

from collections.abc import Iterator
from math import nan
from typing import NamedTuple

import msgspec
import numpy as np
from scipy import special, stats

from eigenfail.values import AXES, Interval
from eigenfail_services.noise_fit.fitting import Fit, find_ratio_interval
from eigenfail_services.noise_fit.sensor_log import Array, SensorLog

FAMILY_ERROR = 0.01
"""Probability that at least one check fails on a log that the model describes."""

FEWEST_TRACKS = 10
"""Tracks that must contribute to a check."""

FAR_SIGMA = 3.0
LAGS = (1, 10)
PARTS = 3
"""Equal parts of the measurements by distance; the nearest and the farthest are checked."""


class ModelCheck(msgspec.Struct, frozen=True):
    """A property that z has under the model, as the log has it.

    Attributes:
        name: what is checked.
        value: value in the log.
        interval: its interval; all of them hold together with probability 1 − `FAMILY_ERROR`.
        expected: value under the model.
        holds: whether the interval holds the expected value.
        remedy: what to do; empty where the check holds.
    """

    name: str
    value: float
    interval: Interval
    expected: float
    holds: bool
    remedy: str


class _Property(NamedTuple):
    """What is asked of the z of a log.

    Attributes:
        name: name of the check.
        values: a value of each measurement, whose mean is asked for, shape (n,).
        expected: their mean under the model.
        remedy: what to do if it is another one.
        is_share: whether the values are 0 and 1.
    """

    name: str
    values: Array
    expected: float
    remedy: str
    is_share: bool = False


def check_fit(log: SensorLog, fit: Fit) -> list[ModelCheck]:
    """Return the checks of a fit: bias, spread at both ends, correlation, tails, time offset.

    Checks to which fewer than `FEWEST_TRACKS` tracks contribute are left out.
    """
    asked = list(_list_properties(log, fit.find_z(log)))
    confidence = 1.0 - FAMILY_ERROR / len(asked)
    checks = []
    for one in asked:
        counted = np.isfinite(one.values)
        sums = log.sum_by_track(np.where(counted, one.values, 0.0))
        counts = log.sum_by_track(counted.astype(float))
        if np.count_nonzero(counts) >= FEWEST_TRACKS:
            value, interval = find_ratio_interval(sums, counts, confidence)
            if one.is_share:
                interval = _widen_share(interval, int(sums.sum()), int(counts.sum()), confidence)
            holds = interval.low <= one.expected <= interval.high
            advice = "" if holds else one.remedy
            checks.append(ModelCheck(one.name, value, interval, one.expected, holds, advice))
    return checks


def _widen_share(interval: Interval, k: int, n: int, confidence: float) -> Interval:
    """Return an interval with the exact one of k of n independent cases (Clopper and Pearson 1934).

    The jackknife alone has no width where no case occurred.
    """
    error = 0.5 * (1.0 - confidence)
    low = float(stats.beta.ppf(error, k, n - k + 1)) if k else 0.0
    high = float(stats.beta.ppf(1.0 - error, k + 1, n - k)) if k < n else 1.0
    return Interval(min(interval.low, low), max(interval.high, high))


def _list_properties(log: SensorLog, z: Array) -> Iterator[_Property]:
    for axis, name in enumerate(AXES):
        own, distance = z[:, axis], log.distance_m[:, axis]
        yield _Property(
            f"{name}: mean of z",
            own,
            0.0,
            "The model has no bias: calibrate the sensor's mounting, or subtract the mean error.",
        )
        low, high = np.quantile(distance, [1.0 / PARTS, 1.0 - 1.0 / PARTS])
        for part, is_counted in (("nearest", distance <= low), ("farthest", distance >= high)):
            yield _Property(
                f"{name}: mean square of z, {part} third",
                np.where(is_counted, np.square(own), nan),
                1.0,
                "Sigma does not grow linearly with the distance: fit shorter ranges apart.",
            )
        for lag in LAGS:
            yield _Property(
                f"{name}: correlation of z, {lag * log.step_s:g} s apart",
                own * _shift(own, log, lag),
                0.0,
                "Errors last in another way than the model's: ar1 knows a single decay.",
            )
        yield _Property(
            f"{name}: share of |z| > {FAR_SIGMA:g}",
            (np.abs(own) > FAR_SIGMA).astype(float),
            2.0 * float(special.ndtr(-FAR_SIGMA)),
            "Extreme errors are more or less frequent than the model's. No shape has both heavy "
            "tails and correlation.",
            is_share=True,
        )
    yield _Property(
        "correlation of z between the axes",
        z[:, 0] * z[:, 1],
        0.0,
        "The errors of the axes depend on each other, which the model leaves out.",
    )
    yield _Property(
        "correlation of longitudinal z with the rate of dx",
        z[:, 0] * _standardise(log.speed_mps[:, 0]),
        0.0,
        "Errors follow the speed, as they do where clocks differ: correct the time stamps.",
    )


def _shift(values: Array, log: SensorLog, lag: int) -> Array:
    """Return each measurement's value `lag` steps earlier; NaN where a step between was missed."""
    found = np.full(len(values), nan)
    found[lag:] = values[:-lag]
    unbroken = log.follows.copy()
    for back in range(1, lag):
        unbroken[back:] &= log.follows[:-back]
        unbroken[:back] = False
    return np.where(unbroken, found, nan)


def _standardise(values: Array) -> Array:
    """Return values less their mean, by their standard deviation; NaN where all are equal."""
    spread = float(np.nanstd(values)) if np.isfinite(values).any() else 0.0
    if spread == 0.0:
        return np.full(len(values), nan)
    standardised: Array = (values - np.nanmean(values)) / spread
    return standardised
