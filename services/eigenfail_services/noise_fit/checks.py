"""Checks whether a log is of the disturbance model that was fitted to it."""

from collections.abc import Iterator, Sequence
from itertools import combinations
from math import nan
from typing import NamedTuple

import msgspec
import numpy as np
from scipy import special

from eigenfail.values import AXES, Interval
from eigenfail.values.channels import MISSED
from eigenfail_services.noise_fit.events import ChainFit
from eigenfail_services.noise_fit.fitting import Fit
from eigenfail_services.noise_fit.jackknife import (
    Array,
    Integers,
    find_ratio_interval,
    widen_share,
)
from eigenfail_services.noise_fit.sensor_log import Booleans, ErrorSeries, EventSteps, SensorLog

FAMILY_ERROR = 0.01
"""Probability that at least one check fails on a log that the model describes."""

FEWEST_TRACKS = 10
"""Tracks that must contribute to a check."""

FAR_SIGMA = 3.0
LAGS = (1, 10)
HALF_SIGMA = 0.6745
"""Half of the standard normal draws are smaller."""

SOON_STEPS = 5
"""Steps after an event in which the next one may begin the sooner."""

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
    """Property that a log must have.

    Attributes:
        name: name of the check.
        values: a value of each record, whose mean is asked for, shape (n,); NaN where there is
            none.
        expected: their mean under the model, or the mean of each one, shape (n,).
        block: number of the block of each record, shape (n,).
        remedy: what to do if it is another one.
        is_share: whether the values are 0 and 1.
    """

    name: str
    values: Array
    expected: float | Array
    block: Integers
    remedy: str
    is_share: bool = False


def check_position(log: SensorLog, fit: Fit) -> list[ModelCheck]:
    """Return the checks of a fit to both axes: bias, spread, correlation, tails, time offset."""
    errors = log.select(*AXES)
    z = fit.find_z(errors)
    between = _list_pairs(log, {"the axes": (errors.row, z[:, 0], z[:, 1])})
    return _judge(
        [*_list_error_properties(log.step_s, errors, z), *between, *_list_clocks(log, errors, z)]
    )


def check_channels(
    log: SensorLog, fits: Sequence[Fit], chains: Sequence[tuple[ChainFit, EventSteps]]
) -> list[ModelCheck]:
    """Return the checks of fits of single channels, and of events."""
    asked: list[_Property] = []
    placed: dict[str, Array] = {}
    for fit in fits:
        errors = log.select(*fit.channels)
        z = fit.find_z(errors)
        asked += _list_error_properties(log.step_s, errors, z)
        asked += _list_central_properties(errors, z)
        (name,) = fit.channels
        placed[name] = np.full(len(log.track), nan)
        placed[name][errors.row] = z[:, 0]
        if name == AXES[0]:
            asked += _list_clocks(log, errors, z)
    pairs = {
        f"{one} and {other}": (np.arange(len(log.track)), placed[one], placed[other])
        for one, other in combinations(placed, 2)
    }
    asked += _list_pairs(log, pairs)
    for chain, steps in chains:
        asked += _list_chain_properties(chain, steps)
    return _judge(asked)


def _judge(asked: Sequence[_Property]) -> list[ModelCheck]:
    """Return the checks; those to which fewer than `FEWEST_TRACKS` blocks contribute are left out.

    Their confidence is such that all of them hold together with probability 1 − `FAMILY_ERROR`.
    """
    confidence = 1.0 - FAMILY_ERROR / len(asked)
    checks = []
    for one in asked:
        counted = np.isfinite(one.values)
        blocks = int(one.block.max(initial=0)) + 1
        counts = np.bincount(one.block, counted, blocks).astype(float)
        if np.count_nonzero(counts) < FEWEST_TRACKS:
            continue
        means = np.broadcast_to(one.expected, len(counted))
        expected = float(means[counted].mean()) if np.ndim(one.expected) else float(means[0])
        # The difference varies less between blocks than the value, where each has its own mean.
        offset = np.where(counted, means - expected, 0.0)
        shifted = np.where(counted, one.values, 0.0) - offset
        sums = np.bincount(one.block, shifted, blocks).astype(float)
        value, interval = find_ratio_interval(sums, counts, confidence)
        if one.is_share:
            k = int(one.values[counted].sum())
            interval = widen_share(interval, k, int(counts.sum()), confidence)
        holds = interval.low <= expected <= interval.high
        advice = "" if holds else one.remedy
        checks.append(ModelCheck(one.name, value, interval, expected, holds, advice))
    return checks


def _list_error_properties(step_s: float, errors: ErrorSeries, z: Array) -> Iterator[_Property]:
    for column, name in enumerate(errors.channels):
        own, distance = z[:, column], errors.distance_m[:, column]
        yield _Property(
            f"{name}: mean of z",
            own,
            0.0,
            errors.track,
            "The model has no bias: calibrate the sensor's mounting, or subtract the mean error.",
        )
        low, high = np.quantile(distance, [1.0 / PARTS, 1.0 - 1.0 / PARTS])
        for part, is_counted in (("nearest", distance <= low), ("farthest", distance >= high)):
            yield _Property(
                f"{name}: mean square of z, {part} third",
                np.where(is_counted, np.square(own), nan),
                1.0,
                errors.track,
                "Sigma does not grow linearly with the distance: fit shorter ranges apart.",
            )
        for lag in LAGS:
            yield _Property(
                f"{name}: correlation of z, {lag * step_s:g} s apart",
                own * shift(own, errors, lag),
                0.0,
                errors.track,
                "Errors last in another way than the model's: ar1 knows a single decay.",
            )
        yield _Property(
            f"{name}: share of |z| > {FAR_SIGMA:g}",
            (np.abs(own) > FAR_SIGMA).astype(float),
            2.0 * float(special.ndtr(-FAR_SIGMA)),
            errors.track,
            "Extreme errors are more or less frequent than the model's. No shape has both heavy "
            "tails and correlation.",
            is_share=True,
        )


def _list_central_properties(errors: ErrorSeries, z: Array) -> Iterator[_Property]:
    for column, name in enumerate(errors.channels):
        yield _Property(
            f"{name}: share of |z| < {HALF_SIGMA:.3g}",
            (np.abs(z[:, column]) < HALF_SIGMA).astype(float),
            1.0 - 2.0 * float(special.ndtr(-HALF_SIGMA)),
            errors.track,
            "Small errors are more or less frequent than the model's: it has another shape.",
            is_share=True,
        )


def _list_pairs(
    log: SensorLog, pairs: dict[str, tuple[Integers, Array, Array]]
) -> Iterator[_Property]:
    """Yield the correlations between z of two channels, given by the rows of the log."""
    for names, (row, one, other) in pairs.items():
        between = "between the axes" if names == "the axes" else f"of {names}"
        yield _Property(
            f"correlation of z {between}",
            one * other,
            0.0,
            log.track[row],
            f"The errors of {names} depend on each other, which the model leaves out.",
        )


def _list_clocks(log: SensorLog, errors: ErrorSeries, z: Array) -> Iterator[_Property]:
    yield _Property(
        "correlation of longitudinal z with the rate of dx",
        z[:, 0] * _standardise(log.rate_mps[errors.row, 0]),
        0.0,
        errors.track,
        "Errors follow the speed, as they do where clocks differ: correct the time stamps.",
    )


def _list_chain_properties(chain: ChainFit, steps: EventSteps) -> Iterator[_Property]:
    expected = chain.compute_probability(steps)
    begins, absent = steps.now.astype(float), ~steps.before

    def ask(name: str, happened: Array, mean: Array, counted: Booleans, remedy: str) -> _Property:
        values = np.where(counted, happened, nan)
        return _Property(f"{chain.name}: {name}", values, mean, steps.block, remedy, is_share=True)

    if chain.name == MISSED:
        low, high = np.quantile(steps.distance_m, [1.0 / PARTS, 1.0 - 1.0 / PARTS])
        thirds = {"nearest": steps.distance_m <= low, "farthest": steps.distance_m >= high}
        for part, inside in thirds.items():
            yield ask(
                f"share of steps at which an event begins, {part} third",
                begins,
                expected,
                absent & inside,
                "The rate does not grow linearly with the distance: fit shorter ranges apart.",
            )
    yield ask(
        f"share of steps at which an event begins, up to {SOON_STEPS} after another",
        begins,
        expected,
        absent & (steps.age > 0) & (steps.age <= SOON_STEPS),
        "Events come in groups, or keep apart; those of the model do neither.",
    )
    for name, of_age in (("after its first step", steps.age == 1), ("later", steps.age > 1)):
        yield ask(
            f"share of runs that end {name}",
            1.0 - begins,
            1.0 - expected,
            steps.before & of_age,
            "How long events last is not geometric: a chain of two states has short and long ones "
            "in fixed proportion.",
        )


def shift(values: Array, errors: ErrorSeries, lag: int) -> Array:
    """Return each measurement's value `lag` steps earlier; NaN where a step between was missed."""
    found = np.full(len(values), nan)
    found[lag:] = values[:-lag]
    unbroken = errors.follows.copy()
    for back in range(1, lag):
        unbroken[back:] &= errors.follows[:-back]
        unbroken[:back] = False
    return np.where(unbroken, found, nan)


def _standardise(values: Array) -> Array:
    """Return values less their mean, by their standard deviation; NaN where all are equal."""
    spread = float(np.nanstd(values)) if np.isfinite(values).any() else 0.0
    if spread == 0.0:
        return np.full(len(values), nan)
    standardised: Array = (values - np.nanmean(values)) / spread
    return standardised
