"""Checks whether a log is of the disturbance model that was fitted to it."""

import re
from collections.abc import Iterator, Mapping, Sequence
from itertools import combinations
from math import inf, nan, pi
from typing import NamedTuple

import msgspec
import numpy as np
from scipy import special, stats

from eigenfail.values.channels import MISSED
from eigenfail.values.disturbance import AXES
from eigenfail.values.estimates import Interval
from eigenfail_noise_fit import jackknife
from eigenfail_noise_fit.events import ChainFit
from eigenfail_noise_fit.fitting import Fit
from eigenfail_noise_fit.sensor_log import Booleans, ErrorSeries, EventSteps, SensorLog

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

CAUSE_ERROR = 1e-4
"""Probability that a check of a cause fails for a channel that the model describes."""

LEAST_CASES = 5
LEAST_SHARE = 0.0005
MOST_EXPECTED = 3.0
"""A cause is named from so many cases and such a share on, if they are so many times what the
values beside them let expect."""

FLIPS = {"180°": pi, "90°": 0.5 * pi}
FLIP_WIDTH_RAD = 0.4
"""Headings that the detector turns by these angles have errors so near to them."""

LARGE_TURN_RAD = 0.25 * pi
MOST_LARGE_TURNS = 0.1
"""Share of errors beyond this angle from which headings are no radians, or no headings."""

DEGREES = 180.0 / pi
WINDOW_S = 1.0
"""Headings are compared with motion over this time. [s]"""

MOVING_MPS, SLOWEST_MPS = 2.0, 0.8
"""Vehicles move from the first speed on. If the log has no speeds, its moving vehicles are taken as
faster than the second: headings in degrees are those of slower ones up to 45 m/s. [m/s]"""

ACROSS_RAD, MOST_ACROSS = 0.5, 0.5
"""Share of headings that are further from the direction of the road than this angle. [rad]"""

ROUNDED_SHARE = 0.01
"""Share of errors of one unit of the last digit from which digits are too few."""

FAR_SPREADS = 10.0
"""Values with errors beyond so many robust standard deviations are looked at for sentinels."""

MAD_SIGMAS = 1.4826
BINS = 10

EXACT = 1e-9
"""Values that differ by less are the same."""

NEIGHBOURS, NEAREST = 20, 3
"""Rounded values on each side whose frequencies a repeated value is held against."""

MOST_NEAR = 2.0
"""A value that is right so many times as often as it is far is no sentinel."""

MOST_NAMED = 8
"""Values that the name of a check lists."""

PARTS = 3
"""Equal parts of the measurements by distance; the nearest and the farthest are checked."""


class ModelCheck(msgspec.Struct, frozen=True):
    """A property that z has under the model, as the log has it.

    Attributes:
        name: property that is checked.
        value: value in the log.
        interval: its interval; all of them hold together with probability 1 − `FAMILY_ERROR`.
        expected: value under the model.
        holds: whether the interval holds the expected value.
        remedy: what to do; empty if the check holds.
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
        values: a value of each record, shape (n,), whose mean is checked; NaN if there is none.
        expected: their mean under the model, or the mean of each one, shape (n,).
        block: number of the block of each record, shape (n,).
        remedy: what to do if the mean differs.
        is_share: whether the values are 0 and 1.
    """

    name: str
    values: jackknife.Array
    expected: float | jackknife.Array
    block: jackknife.Integers
    remedy: str
    is_share: bool = False


def check_position(log: SensorLog, fit: Fit) -> list[ModelCheck]:
    """Return the checks of a fit to both axes: bias, spread, correlation, tails, time offset."""
    errors = log.select(*AXES)
    z = fit.find_z(errors)
    between = _list_pairs(log, {"the axes": (errors.row, z[:, 0], z[:, 1])})
    properties = _list_error_properties(log.step_s, errors, z)
    judged = _judge([*properties, *between, *_list_clocks(log, errors, z)])
    return _add_causes(list(_list_causes(log, errors, z)), judged)


def check_channels(
    log: SensorLog, fits: Sequence[Fit], chains: Sequence[tuple[ChainFit, EventSteps]]
) -> list[ModelCheck]:
    """Return the checks of fits of single channels, and of events."""
    asked: list[_Property] = []
    causes: list[ModelCheck] = []
    placed: dict[str, jackknife.Array] = {}
    for fit in fits:
        errors = log.select(*fit.channels)
        z = fit.find_z(errors)
        asked += _list_error_properties(log.step_s, errors, z)
        asked += _list_central_properties(errors, z)
        causes += _list_causes(log, errors, z)
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
    return _add_causes(causes, _judge(asked))


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
        value, interval = jackknife.find_ratio_interval(sums, counts, confidence)
        if one.is_share:
            k = int(one.values[counted].sum())
            interval = jackknife.widen_share(interval, k, int(counts.sum()), confidence)
        holds = interval.low <= expected <= interval.high
        advice = "" if holds else one.remedy
        checks.append(ModelCheck(one.name, value, interval, expected, holds, advice))
    return checks


def _add_causes(causes: Sequence[ModelCheck], judged: Sequence[ModelCheck]) -> list[ModelCheck]:
    """Return checks of causes before the others, whose remedies would guess at other causes."""
    names = {cause.name.split(":")[0] for cause in causes}
    return [
        *causes,
        *(
            msgspec.structs.replace(check, remedy=SEE_CAUSE)
            if check.remedy and names & set(re.findall(r"[a-z]+", check.name))
            else check
            for check in judged
        ),
    ]


SEE_CAUSE = "Mend what the first checks name, then fit again."


def _list_causes(log: SensorLog, errors: ErrorSeries, z: jackknife.Array) -> Iterator[ModelCheck]:
    """Yield failed checks for causes that make errors look heavy-tailed."""
    for column, name in enumerate(errors.channels):
        own, place = errors.error[:, column], log.channels.index(name)
        sides = {"reported": log.seen[errors.row, place], "true": log.true[errors.row, place]}
        found = [*_list_zeros(name, own)]
        is_named = np.zeros(len(own), bool)
        if name == "heading":
            turns, is_named = _find_turns(own)
            found += turns
        for check, is_sentinel in _list_sentinels(name, sides, own, errors.track, is_named):
            found.append(check)
            is_named = is_named | is_sentinel
        if name == "heading":
            found += (
                _list_units(log, errors)
                or [*_list_unrelated(own, is_named)]
                or _list_ranges({words: side[~is_named] for words, side in sides.items()})
            )
        # The causes above fall on some tracks more often than on others.
        yield from found or _list_uneven_tracks(name, errors, column, z[:, column])


def _make_cause(name: str, cases: int, count: int, expected: float, remedy: str) -> ModelCheck:
    share = cases / count
    interval = jackknife.widen_share(Interval(share, share), cases, count, 1.0 - CAUSE_ERROR)
    return ModelCheck(name, share, interval, expected, holds=False, remedy=remedy)


def _is_conspicuous(cases: int, beside: int, count: int) -> bool:
    """Return whether there are more cases than the number of neighbouring values explains."""
    least = max(LEAST_CASES, LEAST_SHARE * count)
    return cases >= least and cases > MOST_EXPECTED * (beside + 1)


def _find_turns(error: jackknife.Array) -> tuple[list[ModelCheck], Booleans]:
    """Return shares of headings turned by half a turn or a quarter, and which these are."""
    size, count = np.abs(error), len(error)
    is_turned = np.zeros(count, bool)
    found = []
    for words, angle in FLIPS.items():
        apart = np.abs(size - angle)
        near = apart < FLIP_WIDTH_RAD
        # As wide a range beside it: around a quarter turn on both sides, otherwise below.
        beside = (apart >= FLIP_WIDTH_RAD) & (apart < 2.0 * FLIP_WIDTH_RAD)
        if _is_conspicuous(int(near.sum()), int(beside.sum()), count):
            is_turned |= near
            found.append(
                _make_cause(
                    f"heading: share of errors near {words}",
                    int(near.sum()),
                    count,
                    0.0,
                    f"The detector turns these headings by {words}. No channel does so: leave "
                    "their rows without a heading, and fit again.",
                )
            )
    return found, is_turned


def _list_units(log: SensorLog, errors: ErrorSeries) -> list[ModelCheck]:
    """Return failed checks of headings in degrees, which contradict other columns of the log."""
    place = log.channels.index("heading")
    true, seen = log.true[errors.row, place], log.seen[errors.row, place]
    found = []
    both = _find_slope(true, seen, errors)
    for degrees, words in ((DEGREES, "reported"), (1.0 / DEGREES, "true")):
        if both and degrees / 2.0 < both[1].low and both[1].high < degrees * 2.0:
            found.append(
                ModelCheck(
                    "heading: ratio of changes of reported headings to those of true ones",
                    *both,
                    1.0,
                    holds=False,
                    remedy=f"The {words} headings seem to be in degrees, and the others in "
                    "radians. Give radians in both columns.",
                )
            )
    for words, heading in (("true", np.unwrap(true)), ("reported", seen)):
        direction, mean, least, of_what = _find_directions(log, errors, heading)
        ratio = _find_slope(direction, mean, errors)
        if ratio and ratio[1].low > least and not found:
            found.append(
                ModelCheck(
                    f"heading: ratio of changes of {words} headings to those of {of_what}",
                    *ratio,
                    1.0,
                    holds=False,
                    remedy="The headings seem to be in degrees: as radians they contradict the "
                    "way across the road, which follows from dy_m. Give radians in both columns.",
                )
            )
    return found


def _find_directions(
    log: SensorLog, errors: ErrorSeries, heading: jackknife.Array
) -> tuple[jackknife.Array, jackknife.Array, float, str]:
    """Return the directions of motion and the mean headings over `WINDOW_S`, each of shape (n,).

    Also return the ratio of changes above which headings count as degrees, and a name of the
    directions. Directions and mean headings are NaN at gaps of the log.
    """
    across_m, step = log.true[errors.row, 1], log.step[errors.row]
    lag = max(round(WINDOW_S / log.step_s), 1)
    direction, mean = np.full((2, len(heading)), nan)
    if len(heading) <= lag:
        return direction, mean, 0.0, ""
    sums = np.cumsum(0.5 * (heading[1:] + heading[:-1]), axis=0)
    sums = np.concatenate([[0.0], sums])
    is_whole = (errors.track[lag:] == errors.track[:-lag]) & (step[lag:] - step[:-lag] == lag)
    mean[lag:] = np.where(is_whole, (sums[lag:] - sums[:-lag]) / lag, nan)
    rate = (across_m[lag:] - across_m[:-lag]) / (lag * log.step_s)
    # A vehicle that comes towards the ego turns to its own left, as the others do.
    rate *= np.where(_average(np.cos(heading), errors) < -0.5, -1.0, 1.0)[errors.track[lag:]]
    speeds = log.true[errors.row, log.channels.index("speed")] if "speed" in log.channels else None
    if speeds is not None and (np.abs(speeds) > MOVING_MPS).any():
        speed = np.abs(0.5 * (speeds[lag:] + speeds[:-lag]))
        moves = is_whole & (speed > MOVING_MPS)
        direction[lag:] = np.where(moves, rate / np.maximum(speed, MOVING_MPS), nan)
        return direction, mean, DEGREES**0.5, "the direction of motion"
    # All vehicles are faster than this, but for those that stand and so do not turn.
    direction[lag:] = np.where(is_whole, rate / SLOWEST_MPS, nan)
    return direction, mean, 1.0, f"the direction of motion at {SLOWEST_MPS:g} m/s"


def _average(values: jackknife.Array, errors: ErrorSeries) -> jackknife.Array:
    """Return the mean of each track, shape (tracks,); 0 for a track without values."""
    known = np.isfinite(values)
    counts = np.bincount(errors.track[known], minlength=errors.tracks)
    sums = np.bincount(errors.track[known], values[known], errors.tracks)
    means: jackknife.Array = sums / np.maximum(counts, 1)
    return means


def _find_slope(
    x: jackknife.Array, y: jackknife.Array, errors: ErrorSeries
) -> tuple[float, Interval] | None:
    """Return the slope of y over x within tracks, with its interval; None if x does not change."""
    both = np.isfinite(x) & np.isfinite(y)
    x, y = np.where(both, x, nan), np.where(both, y, nan)
    x, y = (each - _average(each, errors)[errors.track] for each in (x, y))
    squares, products = (
        np.bincount(errors.track[both], (x * each)[both], errors.tracks).astype(float)
        for each in (x, y)
    )
    squares[squares < EXACT] = 0.0
    if np.count_nonzero(squares) < FEWEST_TRACKS:
        return None
    return jackknife.find_ratio_interval(products, squares, 1.0 - CAUSE_ERROR)


def _list_unrelated(error: jackknife.Array, is_named: Booleans) -> Iterator[ModelCheck]:
    """Yield a failed check if many large errors of headings lack a known cause."""
    large = int(((np.abs(error) > LARGE_TURN_RAD) & ~is_named).sum())
    if large > MOST_LARGE_TURNS * len(error):
        yield _make_cause(
            "heading: share of other errors beyond 45°",
            large,
            len(error),
            0.0,
            "Both columns must be headings in radians, anticlockwise from the road: these seem "
            "to be in degrees, or unrelated.",
        )


def _list_ranges(sides: Mapping[str, jackknife.Array]) -> list[ModelCheck]:
    """Return failed checks of columns of headings, by name, that fill more than a turn."""
    found = []
    for words, heading in sides.items():
        low, high = float(heading.min(initial=0.0)), float(heading.max(initial=0.0))
        # Radians beyond a turn are those of vehicles that were followed through it: most of them
        # point along the road.
        is_across = np.abs(np.sin(heading)) > np.sin(ACROSS_RAD)
        if high - low > 2.0 * pi + ACROSS_RAD and is_across.mean() > MOST_ACROSS:
            found.append(
                ModelCheck(
                    f"heading: range of {words} headings",
                    high - low,
                    Interval(high - low, high - low),
                    2.0 * pi,
                    holds=False,
                    remedy="The headings exceed a turn, and few are along the road: they seem to "
                    "be in degrees. Give radians between -π and π in both columns.",
                )
            )
    return found


def _list_zeros(name: str, error: jackknife.Array) -> Iterator[ModelCheck]:
    """Yield a failed check if more errors are exactly 0 than rounding explains."""
    size = np.abs(error)
    is_zero = size < EXACT
    if is_zero.all() or not is_zero.any():
        return
    # The smallest error of all is a unit of the last digit, if values are rounded.
    unit = float(size[~is_zero].min())
    beside = int((np.abs(size - unit) < 0.5 * unit).sum())
    zeros = int(is_zero.sum())
    if _is_conspicuous(zeros, beside, len(error)):
        # Rounded values of small errors have their nearest neighbours often.
        is_rounded = beside > ROUNDED_SHARE * len(error)
        rounded = f"The values are rounded to {unit:.3g}, which hides errors: log more digits."
        copied = (
            "There the true value is the reported one: take the truth from a reference that does "
            "not depend on this sensor, or remove these rows."
        )
        yield _make_cause(
            f"{name}: share of errors that are exactly 0",
            zeros,
            len(error),
            beside / 2.0 / len(error),
            rounded if is_rounded else copied,
        )


def _list_sentinels(
    name: str,
    sides: Mapping[str, jackknife.Array],
    error: jackknife.Array,
    track: jackknife.Integers,
    is_turned: Booleans,
) -> Iterator[tuple[ModelCheck, Booleans]]:
    """Yield the share of rows with far values that are repeated exactly, and which rows these are.

    Args:
        name: name of the channel.
        sides: reported and true values, each of shape (n,), by name.
        error: reported less true values, shape (n,).
        track: number of the track of each, shape (n,).
        is_turned: which errors have another cause, shape (n,).
    """
    # Values of the same decimals may differ in their last bits after a change of units.
    rounded = {words: values.round(9) for words, values in sides.items()}
    # A value that lasts while nothing else changes is one case: the vehicle may be parked.
    _, case = np.unique(np.column_stack([*rounded.values(), track]), axis=0, return_index=True)
    is_case = np.zeros(len(error), bool)
    is_case[case] = True
    # Sentinels may be most of the errors, so the scale is that of the other values.
    is_usual = np.ones(len(error), bool)
    units = {
        words: np.diff(np.unique(values)).min(initial=inf) for words, values in rounded.items()
    }
    for words, values in rounded.items():
        is_usual &= ~np.isin(values, _find_repeated(values[is_case], units[words]))
    is_far = _find_far(error, error[is_usual] if is_usual.any() else error) & ~is_turned
    for words, values in rounded.items():
        repeated = _find_repeated(values[is_case & is_far], units[words])
        used = _find_repeated(values[is_case & ~is_far], units[words])
        counts = {}
        for value in repeated.tolist():
            is_value = values == value
            cases = int((is_value & is_far).sum())
            # Some sensors report one value for each class: its errors are other classes' vehicles.
            is_class = value in used and (is_value & ~is_far).sum() > MOST_NEAR * cases
            if cases >= max(LEAST_CASES, LEAST_SHARE * len(error)) and not is_class:
                counts[value] = cases
        if not counts:
            continue
        ordered = sorted(counts, key=counts.__getitem__, reverse=True)
        are = [f"{value:g}" for value in ordered[:MOST_NAMED]]
        more = f" and {len(ordered) - MOST_NAMED} more" if len(ordered) > MOST_NAMED else ""
        yield (
            _make_cause(
                f"{name}: share of {words} values that are {' or '.join(are)}{more}",
                sum(counts.values()),
                len(error),
                0.0,
                "Far values are repeated exactly, as those that mean 'no measurement'. Leave the "
                "fields empty there.",
            ),
            np.isin(values, ordered),
        )


def _find_far(error: jackknife.Array, usual: jackknife.Array) -> Booleans:
    """Return which errors are far beyond the usual ones."""
    middle = float(np.median(usual))
    size = np.abs(usual - middle)
    if float(np.median(size)) <= EXACT and (size > EXACT).any():
        # Most errors are the same, which is a cause of its own; the others have a scale.
        size = size[size > EXACT]
    least = max(FAR_SPREADS * MAD_SIGMAS * float(np.median(size)), EXACT)
    far: Booleans = np.abs(error - middle) > least
    return far


def _find_repeated(cases: jackknife.Array, unit: float) -> jackknife.Array:
    """Return the values that are repeated more often than the values around them let expect.

    Args:
        cases: values, shape (n,).
        unit: least difference of two values: neighbours of rounded values are about as frequent.
    """
    values, counts = np.unique(cases, return_counts=True)
    found = []
    for place in np.flatnonzero(counts >= LEAST_CASES).tolist():
        apart = np.rint((values - values[place]) / unit)
        is_beside = (np.abs(apart) <= NEIGHBOURS) & (apart != 0.0)
        around = np.zeros(2 * NEIGHBOURS)
        around[: is_beside.sum()] = counts[is_beside]
        # Other sentinels may be among the neighbours.
        most = MOST_EXPECTED * (float(np.median(around)) + 1.0)
        next_to = np.sort(counts[is_beside & (np.abs(apart) <= NEAREST)])
        mean = max(
            float((np.minimum(around, most).sum() + 1.0) / len(around)),
            float(next_to[-2]) if len(next_to) > 1 else 0.0,
        )
        chance = len(values) * float(special.gammainc(counts[place], mean))
        if chance < CAUSE_ERROR and counts[place] > MOST_EXPECTED * mean:
            found.append(float(values[place]))
    return np.array(found)


def _list_uneven_tracks(
    name: str, errors: ErrorSeries, column: int, z: jackknife.Array
) -> Iterator[ModelCheck]:
    """Yield the variance of mean z² between tracks, if it is larger than the model's.

    The mean square of n standard normal values has the variance 2 / n. The sum over tracks of n
    (mean − 1)² / 2 is approximated by a gamma variable with the same mean and variance. Each
    summand has the mean 1 and the variance 2 + 12 / n.
    """
    edges = np.quantile(errors.distance_m[:, column], np.linspace(0.0, 1.0, BINS + 1)[1:-1])
    part = np.searchsorted(edges, errors.distance_m[:, column])
    # Single far errors are other checks' matter, and so is a wrong dependence on distance.
    square = np.minimum(np.square(z), FAR_SIGMA**2)
    usual = np.bincount(part, square, BINS) / np.maximum(np.bincount(part, minlength=BINS), 1)
    # All errors of a part may be exactly 0.
    square /= np.where(usual > 0.0, usual, 1.0)[part]
    n = np.bincount(errors.track, minlength=errors.tracks).astype(float)
    means = np.bincount(errors.track, square, errors.tracks) / n
    tracks = errors.tracks - 1.0
    total = float((0.5 * n * np.square(means - 1.0)).sum())
    scale = float((2.0 + 12.0 / n).mean())
    low, high = (
        float(stats.gamma.ppf(share, tracks / scale, scale=scale))
        for share in (0.5 * CAUSE_ERROR, 1.0 - 0.5 * CAUSE_ERROR)
    )
    if total <= high:
        return
    yield ModelCheck(
        f"{name}: variance of mean z² between tracks, over the model's",
        total / tracks,
        Interval(total / high, total / low),
        1.0,
        holds=False,
        remedy="Sigma differs from vehicle to vehicle, which the model makes heavy tails at single "
        "steps of. Fit kinds of vehicles or conditions apart.",
    )


def _list_error_properties(
    step_s: float, errors: ErrorSeries, z: jackknife.Array
) -> Iterator[_Property]:
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


def _list_central_properties(errors: ErrorSeries, z: jackknife.Array) -> Iterator[_Property]:
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
    log: SensorLog, pairs: dict[str, tuple[jackknife.Integers, jackknife.Array, jackknife.Array]]
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


def _list_clocks(log: SensorLog, errors: ErrorSeries, z: jackknife.Array) -> Iterator[_Property]:
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

    def ask(
        name: str, happened: jackknife.Array, mean: jackknife.Array, counted: Booleans, remedy: str
    ) -> _Property:
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


def shift(values: jackknife.Array, errors: ErrorSeries, lag: int) -> jackknife.Array:
    """Return each measurement's value `lag` steps earlier; NaN if a step between was missed."""
    found = np.full(len(values), nan)
    found[lag:] = values[:-lag]
    unbroken = errors.follows.copy()
    for back in range(1, lag):
        unbroken[back:] &= errors.follows[:-back]
        unbroken[:back] = False
    return np.where(unbroken, found, nan)


def _standardise(values: jackknife.Array) -> jackknife.Array:
    """Return values less their mean, by their standard deviation; NaN if they do not differ."""
    spread = float(np.nanstd(values)) if np.isfinite(values).any() else 0.0
    if spread == 0.0:
        return np.full(len(values), nan)
    standardised: jackknife.Array = (values - np.nanmean(values)) / spread
    return standardised
