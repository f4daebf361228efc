"""A log of a sensor's measurements of other vehicles, with their true values."""

from collections.abc import Sequence
from math import isnan, nan, pi
from typing import NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from eigenfail.errors import InvalidValue
from eigenfail.values.channels import QUANTITIES, UNIT_SUFFIXES
from eigenfail.values.disturbance import AXES
from eigenfail_noise_fit.jackknife import Array, Integers

Booleans = NDArray[np.bool_]

TRUE, SEEN = slice(0, 2), slice(2, 4)

POSITION_COLUMNS = ("dx_m", "dy_m")

MEASURED = ("heading", "speed", "length", "width")
"""Quantities that a log may have besides the position."""

FEWEST_TRACKS = 30
"""Intervals rest on the differences between tracks; with fewer of them they are too narrow."""

CLOCK_TOLERANCE = 0.1
"""Largest deviation of a time from a whole number of steps, as a share of a step."""

LEAST_CONSECUTIVE = 0.5
"""Share of the measurements that must come one step after another, to tell how errors last."""

LEAST_RANGE_M = 0.1
"""Least difference between the distances of a channel, to tell a slope from a base. [m]"""

GHOST_BLOCKS = 40
"""Stretches of time over which ghosts are counted, in place of tracks."""


def name_columns(channel: str) -> tuple[str, str]:
    """Return the columns of a channel's true value and of the reported one."""
    position = dict(zip(AXES, POSITION_COLUMNS, strict=True))
    column = position.get(channel, f"{channel}{UNIT_SUFFIXES[QUANTITIES[channel].unit]}")
    return column, f"seen_{column}"


class Row(NamedTuple):
    """One measurement. Values are NaN if the log has none.

    Attributes:
        positions: dx, dy, seen dx, seen dy. [m]
        others: true and reported value of each further quantity, in turn.
    """

    track: str
    time_s: float
    positions: tuple[float, ...]
    others: tuple[float, ...] = ()


class ErrorSeries(msgspec.Struct, frozen=True, eq=False):
    """Errors of some channels at the steps at which all of them were measured.

    Attributes:
        channels: their names.
        row: row of the log of each measurement, shape (n,).
        track: number of its track among those with measurements, from 0 on, shape (n,).
        follows: whether the measurement one step earlier is the one before it, shape (n,).
        distance_m: true distance that sigma depends on, shape (n, channels). [m]
        error: reported less true value, shape (n, channels).
        tracks: number of tracks with measurements.
    """

    channels: tuple[str, ...]
    row: Integers
    track: Integers
    follows: Booleans
    distance_m: Array
    error: Array
    tracks: int


class EventSteps(msgspec.Struct, frozen=True, eq=False):
    """Steps of an event that follow another step of the log, with the state at that step.

    Attributes:
        block: number of the block of each step, shape (n,).
        before: whether the event lasted at the step before, shape (n,).
        now: whether it lasts, shape (n,).
        age: number of steps that the state before had lasted; 0 if the log does not hold
            the beginning of that state.
        distance_m: true distance at the step in the plane, shape (n,); 0 for ghosts. [m]
        blocks: number of blocks.
    """

    block: Integers
    before: Booleans
    now: Booleans
    age: Integers
    distance_m: Array
    blocks: int


class Ghosts(msgspec.Struct, frozen=True, eq=False):
    """Measurements without a vehicle.

    Attributes:
        measurements: their number.
        first: dx and dy where each ghost ahead was first seen, shape (ghosts, 2). [m]
        behind: number of ghosts that were first seen next to or behind the ego's centre.
        apart: number of measurements at times without a vehicle in the log.
        steps: whether a ghost ahead was seen, at the times at which the log has a vehicle; None
            if it was at none of them.
    """

    measurements: int
    first: Array
    behind: int
    apart: int
    steps: EventSteps | None


class SensorLog(msgspec.Struct, frozen=True, eq=False):
    """The rows of vehicles of a log, ordered by track and time.

    Attributes:
        channels: names of the channels whose errors were measured, the position's first.
        track: number of the track of each row, shape (n,).
        step: number of the step of each row, from the first of its track, shape (n,).
        distance_m: true distance that each channel's sigma depends on, shape (n, channels). [m]
        plane_m: true distance in the plane, shape (n,). [m]
        rate_mps: rate at which dx and dy change, shape (n, 2); NaN at the first of a track. [m/s]
        error: reported less true value, shape (n, channels); NaN if it was not measured.
        true: true value, shape (n, channels); NaN if it is not known.
        seen: reported value, shape (n, channels); NaN if it was not measured.
        step_s: time between two steps. [s]
        ghosts: measurements without a vehicle.
        unread: columns of its file that are not used.
    """

    channels: tuple[str, ...]
    track: Integers
    step: Integers
    distance_m: Array
    plane_m: Array
    rate_mps: Array
    error: Array
    true: Array
    seen: Array
    step_s: float
    ghosts: Ghosts
    unread: tuple[str, ...] = ()

    @property
    def is_missed(self) -> Booleans:
        """Flags of steps at which the sensor missed the vehicle, shape (n,)."""
        return np.isnan(self.error[:, 0])

    @property
    def has_events(self) -> bool:
        """True if a vehicle was missed, or a ghost seen."""
        return bool(self.is_missed.any()) or self.ghosts.measurements > 0

    def select(self, *channels: str) -> ErrorSeries:
        """Return the errors of some channels."""
        columns = [self.channels.index(name) for name in channels]
        row = np.flatnonzero(np.isfinite(self.error[:, columns]).all(axis=1))
        _, track = np.unique(self.track[row], return_inverse=True)
        follows = np.zeros(len(row), bool)
        follows[1:] = (np.diff(self.track[row]) == 0) & (np.diff(self.step[row]) == 1)
        return ErrorSeries(
            channels=channels,
            row=row,
            track=track,
            follows=follows,
            distance_m=np.ascontiguousarray(self.distance_m[row][:, columns]),
            error=np.ascontiguousarray(self.error[row][:, columns]),
            tracks=int(track.max(initial=-1)) + 1,
        )

    def list_miss_steps(self) -> EventSteps:
        """Return the steps at which vehicles were missed, or not; blocks are tracks."""
        follows = (np.diff(self.track) == 0) & (np.diff(self.step) == 1)
        return _list_steps(self.is_missed, follows, self.track, self.plane_m)

    def count_misses(self) -> int:
        """Return the number of runs of misses."""
        missed = self.is_missed
        begins = missed.copy()
        begins[1:] &= ~(missed[:-1] & (np.diff(self.track) == 0))
        return int(begins.sum())


def make_log(
    rows: Sequence[Row],
    step_s: float,
    quantities: Sequence[str] = (),
    unread: tuple[str, ...] = (),
) -> SensorLog:
    """Return the errors of some measurements.

    Args:
        rows: measurements in any order.
        step_s: time between two steps. [s]
        quantities: quantities besides the position that the rows have.
        unread: columns of their file that are not used.

    Raises:
        InvalidValue: as `read_log`.
    """
    by_track = _group_by_track(rows)
    steps = [
        _count_steps(name, np.array([row.time_s for row in track]), step_s)
        for name, track in by_track.items()
    ]
    vehicles = [row for track in by_track.values() for row in track]
    track = np.repeat(np.arange(len(by_track)), [len(track) for track in by_track.values()])
    step = np.concatenate(steps)
    positions = np.array([row.positions for row in vehicles])
    true = positions[:, TRUE]
    plane_m = np.hypot(true[:, 0], true[:, 1])
    rate = np.full_like(true, nan)
    is_later = np.diff(track) == 0
    rate[1:][is_later] = (
        np.diff(true, axis=0)[is_later] / (np.diff(step)[is_later] * step_s)[:, None]
    )
    others = np.array([row.others for row in vehicles]).reshape(len(vehicles), -1)
    log = SensorLog(
        channels=(*AXES, *quantities),
        track=track,
        step=step,
        distance_m=np.column_stack([np.abs(true), *[plane_m] * len(quantities)]),
        plane_m=plane_m,
        rate_mps=rate,
        error=np.column_stack([positions[:, SEEN] - true, _find_errors(others, quantities)]),
        true=np.column_stack([true, others[:, ::2]]),
        seen=np.column_stack([positions[:, SEEN], others[:, 1::2]]),
        step_s=step_s,
        ghosts=_find_ghosts(rows, step_s),
        unread=unread,
    )
    _refuse_uninformative(log)
    return log


def _group_by_track(rows: Sequence[Row]) -> dict[str, list[Row]]:
    """Return the rows of vehicles by track, each track in order of time.

    Raises:
        InvalidValue: too few tracks contain measurements of a vehicle.
    """
    by_track: dict[str, list[Row]] = {}
    for row in rows:
        if not isnan(row.positions[0]):
            by_track.setdefault(row.track, []).append(row)
    for track in by_track.values():
        track.sort(key=lambda row: row.time_s)
    seen = sum(any(not isnan(row.positions[2]) for row in track) for track in by_track.values())
    if seen < FEWEST_TRACKS:
        raise InvalidValue(
            "track",
            f"{seen} tracks contain measurements of a vehicle; at least {FEWEST_TRACKS} are "
            "required, as intervals rest on the differences between tracks.",
            "Log more vehicles. A track starts where the sensor first sees a vehicle, and ends "
            "where it loses it.",
        )
    return by_track


def _count_steps(name: str, time_s: Array, step_s: float) -> Integers:
    """Return the number of each measurement's step, counted from the first measurement.

    Raises:
        InvalidValue: two measurements at one step, or one between two steps.
    """
    exact = (time_s - time_s[0]) / step_s
    steps: Integers = np.rint(exact).astype(np.int64)
    if (apart := np.abs(exact - steps) > CLOCK_TOLERANCE).any():
        wrong = float(time_s[int(np.argmax(apart))])
        raise InvalidValue(
            "time_s",
            f"the measurement of track {name} at {wrong:g} s is not a whole number of steps of "
            f"{step_s:g} s after the first one at {float(time_s[0]):g} s.",
            "Resample the log to this step, or give the period of the log as --step.",
        )
    if (again := np.diff(steps) < 1).any():
        raise InvalidValue(
            "time_s",
            f"track {name} has two measurements at {float(time_s[int(np.argmax(again))]):g} s.",
            "Remove one of them, or give each vehicle and each drive a track of its own.",
        )
    return steps


def _find_errors(others: Array, quantities: Sequence[str]) -> Array:
    """Return reported less true values, of headings as the smaller of both turns."""
    errors: Array = others[:, 1::2] - others[:, ::2]
    turns = [place for place, name in enumerate(quantities) if name == "heading"]
    errors[:, turns] = (errors[:, turns] + pi) % (2.0 * pi) - pi
    return errors


def _list_steps(
    lasts: Booleans, follows: Booleans, block: Integers, distance_m: Array
) -> EventSteps:
    """Return the steps of an event.

    Args:
        lasts: whether the event lasts at each record, shape (n,).
        follows: whether each record but the first is one step after the one before, shape (n − 1,).
        block: number of the block of each record, shape (n,).
        distance_m: distance at each record, shape (n,). [m]
    """
    age = np.zeros(len(lasts), np.int64)
    for place in range(1, len(lasts)):
        if not follows[place - 1]:
            continue
        if lasts[place] != lasts[place - 1]:
            age[place] = 1
        elif age[place - 1]:
            age[place] = age[place - 1] + 1
    before, now = np.flatnonzero(follows), np.flatnonzero(follows) + 1
    return EventSteps(
        block=block[now],
        before=lasts[before],
        now=lasts[now],
        age=age[before],
        distance_m=distance_m[now],
        blocks=int(block.max()) + 1,
    )


def _find_ghosts(rows: Sequence[Row], step_s: float) -> Ghosts:
    """Return the measurements without a vehicle.

    Raises:
        InvalidValue: there are ghosts, and all tracks of vehicles begin at the same time, so that
            they do not share a clock.
    """
    ghosts = [row for row in rows if isnan(row.positions[0]) and not isnan(row.positions[2])]
    first: dict[str, Row] = {}
    for row in ghosts:
        if row.track not in first or row.time_s < first[row.track].time_s:
            first[row.track] = row
    ahead = {name for name, row in first.items() if row.positions[2] > 0.0}
    begins: dict[str, float] = {}
    for row in rows:
        if not isnan(row.positions[0]):
            begins[row.track] = min(begins.get(row.track, row.time_s), row.time_s)
    if ghosts and len(set(begins.values())) == 1:
        raise InvalidValue(
            "time_s",
            "all tracks begin at the same time, so that it cannot be told at which steps no ghost "
            "was seen.",
            "Give times of one clock for all tracks. Where there are several drives, add another "
            "offset to the times of each.",
        )
    # Times halfway between two steps of the clock's zero would be rounded up or down by chance.
    start_s = min(begins.values(), default=0.0)
    seen = [row.time_s for row in rows if not isnan(row.positions[0])]
    times = np.unique(np.array([_find_step(at_s - start_s, step_s) for at_s in seen], np.float64))
    at = np.array([_find_step(row.time_s - start_s, step_s) for row in ghosts], np.float64)
    is_ahead = np.array([row.track in ahead for row in ghosts], bool)
    lasts = np.isin(times, at[is_ahead])
    steps = None
    if lasts.any():
        block = np.arange(len(times)) * GHOST_BLOCKS // len(times)
        steps = _list_steps(lasts, np.diff(times) == 1, block, np.zeros(len(times)))
    return Ghosts(
        measurements=len(ghosts),
        first=np.array([first[name].positions[SEEN] for name in first if name in ahead]).reshape(
            -1, 2
        ),
        behind=len(first) - len(ahead),
        apart=int((~np.isin(at, times)).sum()),
        steps=steps,
    )


def _find_step(time_s: float, step_s: float) -> int:
    """Return the number of the step of the log's clock that a time belongs to."""
    return round(time_s / step_s)


def _refuse_uninformative(log: SensorLog) -> None:
    """Refuse a log that does not determine a parameter.

    Raises:
        InvalidValue: few measurements are one step apart, or the distances or the errors of a
            channel are all equal, or a quantity was measured on too few tracks.
    """
    consecutive = float(log.select(*AXES).follows.mean())
    if consecutive < LEAST_CONSECUTIVE:
        raise InvalidValue(
            "time_s",
            f"only {100.0 * consecutive:.3g} % of the measurements come one step of "
            f"{log.step_s:g} s after another of their track.",
            "Give times in seconds. If the sensor is slower, give its period as --step.",
        )
    for name, distance in zip(POSITION_COLUMNS, log.select(*AXES).distance_m.T, strict=True):
        if np.ptp(distance) < LEAST_RANGE_M:
            raise InvalidValue(
                name,
                f"all distances are about {float(distance.mean()):.3g} m, so that it cannot be "
                "told how errors grow with the distance.",
                "Log vehicles at different distances along the road, and in other lanes.",
            )
    for name in log.channels:
        _refuse_uninformative_channel(log.select(name))


def _refuse_uninformative_channel(errors: ErrorSeries) -> None:
    (name,) = errors.channels
    _, column = name_columns(name)
    if errors.tracks < FEWEST_TRACKS:
        raise InvalidValue(
            column,
            f"{errors.tracks} tracks contain it next to the true value; at least {FEWEST_TRACKS} "
            "are required.",
            "Log more of them, or leave out the column.",
        )
    if not np.ptp(errors.error):
        unit = QUANTITIES[name].unit
        raise InvalidValue(
            column,
            f"all errors are {float(errors.error[0, 0]):.3g} {unit}.",
            f"Give the {'position' if name in AXES else name} that the sensor reported, not the "
            "true one.",
        )
