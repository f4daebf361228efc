"""Checks whether a log is of the disturbance model that was fitted to it."""

from collections.abc import Iterator
from math import nan

import msgspec
import numpy as np
from scipy import special

from eigenfail.values import AXES, Interval
from eigenfail_services.noise_fit.fitting import Fit, find_ratio_interval
from eigenfail_services.noise_fit.sensor_log import Array, SensorLog

FAMILY_ERROR = 0.01
"""Probability that at least one check fails on a log that the model describes."""

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
        remedy: what to do where it does not hold.
    """

    name: str
    value: float
    interval: Interval
    expected: float
    remedy: str

    @property
    def holds(self) -> bool:
        """Whether the interval holds the expected value."""
        return self.interval.low <= self.expected <= self.interval.high


def check_fit(log: SensorLog, fit: Fit) -> list[ModelCheck]:
    """Return the checks of a fit: bias, spread at both ends, correlation, tails, time offset."""
    asked = list(_list_values(log, fit.z))
    confidence = 1.0 - FAMILY_ERROR / len(asked)
    checks = []
    for name, values, is_counted, expected, remedy in asked:
        counted = is_counted & np.isfinite(values)
        sums = log.sum_by_track(np.where(counted, values, 0.0))
        counts = log.sum_by_track(counted.astype(float))
        if counts.sum() > counts.max(initial=0.0) > 0.0:
            value, interval = find_ratio_interval(sums, counts, confidence)
            checks.append(ModelCheck(name, value, interval, expected, remedy))
    return checks


Asked = tuple[str, Array, Array, float, str]
"""Name, values of the measurements, those that count, expected mean, remedy."""


def _list_values(log: SensorLog, z: Array) -> Iterator[Asked]:
    everywhere = np.ones(len(z), bool)
    for axis, name in enumerate(AXES):
        own, distance = z[:, axis], log.distance_m[:, axis]
        yield (
            f"{name}: mean of z",
            own,
            everywhere,
            0.0,
            "The model has no bias: calibrate the sensor's mounting, or subtract the mean error.",
        )
        low, high = np.quantile(distance, [1.0 / PARTS, 1.0 - 1.0 / PARTS])
        for part, is_counted in (("nearest", distance <= low), ("farthest", distance >= high)):
            yield (
                f"{name}: mean square of z, {part} third",
                np.square(own),
                is_counted,
                1.0,
                "Sigma does not grow linearly with the distance: fit shorter ranges apart.",
            )
        for lag in LAGS:
            yield (
                f"{name}: correlation of z, {lag * log.step_s:g} s apart",
                own * _shift(own, log, lag),
                everywhere,
                0.0,
                "Errors last in another way than the model's: ar1 knows a single decay.",
            )
        yield (
            f"{name}: share of |z| > {FAR_SIGMA:g}",
            (np.abs(own) > FAR_SIGMA).astype(float),
            everywhere,
            2.0 * float(special.ndtr(-FAR_SIGMA)),
            (
                "Extreme errors are more or less frequent than the model's. No shape has both "
                "heavy tails and correlation."
            ),
        )
    yield (
        "product of longitudinal and lateral z",
        z[:, 0] * z[:, 1],
        everywhere,
        0.0,
        "The errors of the axes depend on each other, which the model leaves out.",
    )
    yield (
        "longitudinal error by closing speed, product with z",
        z[:, 0] * _standardise(log.speed_mps[:, 0]),
        everywhere,
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
