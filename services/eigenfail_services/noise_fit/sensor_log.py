"""A log of the positions that a sensor reported of other vehicles, and of their true ones."""

import csv
from collections.abc import Iterator, Mapping, Sequence
from math import isfinite, isnan, nan
from pathlib import Path
from typing import NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from eigenfail.errors import InvalidValue

Array = NDArray[np.float64]
Integers = NDArray[np.int64]

COLUMNS = {
    "track": "name or number of one vehicle from when the sensor first saw it until it lost it",
    "time_s": "time of the measurement [s]",
    "dx_m": "true position of the vehicle's centre from the ego's, along the road [m]",
    "dy_m": "the same across the road, positive to the left [m]",
    "seen_dx_m": "position that the sensor reported, along the road [m]; empty where it missed",
    "seen_dy_m": "the same across the road [m]; empty where it missed",
}
"""Columns that a log must have, in any order. Others are ignored."""

POSITIONS = ("dx_m", "dy_m", "seen_dx_m", "seen_dy_m")
TRUE, SEEN = slice(0, 2), slice(2, 4)

FEWEST_TRACKS = 30
"""Intervals rest on the differences between tracks; with fewer of them they are too narrow."""

CLOCK_TOLERANCE = 0.1
"""Largest deviation of a time from a whole number of steps, as a share of a step."""

LEAST_CONSECUTIVE = 0.5
"""Share of the measurements that must come one step after another, to tell how errors last."""

LEAST_RANGE_M = 0.1
"""Least difference between the distances of an axis, to tell a slope from a base. [m]"""


class Row(NamedTuple):
    """One measurement: positions are NaN where the log has none."""

    track: str
    time_s: float
    positions: tuple[float, ...]


class SensorLog(msgspec.Struct, frozen=True, eq=False):
    """Errors of a sensor at the steps at which it saw a vehicle, ordered by track and time.

    Attributes:
        track: number of the track of each measurement, from 0 on, shape (n,).
        follows: whether the measurement one step earlier is the one before it, shape (n,).
        distance_m: |dx| and |dy| of the true position, shape (n, 2). [m]
        speed_mps: rate at which dx and dy change, shape (n, 2); NaN at the first of a track. [m/s]
        error_m: seen less true position, shape (n, 2). [m]
        step_s: time between measurements. [s]
        tracks: number of tracks.
        missed: number of rows in which a vehicle was not seen.
        misses: number of runs of such rows.
        ghosts: number of measurements without a vehicle.
    """

    track: Integers
    follows: NDArray[np.bool_]
    distance_m: Array
    speed_mps: Array
    error_m: Array
    step_s: float
    tracks: int
    missed: int
    misses: int
    ghosts: int

    def sum_by_track(self, values: Array) -> Array:
        """Return the sums of values of the measurements, shape (n,), over each track."""
        return np.bincount(self.track, values, self.tracks).astype(np.float64)


def read_log(file: Path, step_s: float) -> SensorLog:
    """Read a log of CSV, or of Parquet where pyarrow is installed.

    Args:
        file: table with the columns `COLUMNS`.
        step_s: time between two measurements, which is that between two steps of a scenario. [s]

    Raises:
        InvalidValue: the file cannot be read, lacks a column, holds a value that is no number, has
            too few tracks, times that are not a whole number of steps apart, or distances that do
            not differ.
    """
    read = _read_parquet if file.suffix.lower() == ".parquet" else _read_csv
    rows = [_parse(values, file.name, line) for line, values in read(file)]
    if not rows:
        raise InvalidValue(file.name, "contains no rows.", "Give a row for each track and step.")
    return make_log(rows, step_s)


def make_log(rows: Sequence[Row], step_s: float) -> SensorLog:
    """Return the errors of some measurements.

    Raises:
        InvalidValue: as `read_log`.
    """
    ghosts = sum(isnan(row.positions[0]) and not isnan(row.positions[2]) for row in rows)
    by_track: dict[str, list[Row]] = {}
    for row in rows:
        if not isnan(row.positions[0]):
            by_track.setdefault(row.track, []).append(row)
    everything = [_measure_track(name, track, step_s) for name, track in by_track.items()]
    parts = [part for part in everything if part.error_m.size]
    if len(parts) < FEWEST_TRACKS:
        raise InvalidValue(
            "track",
            f"{len(parts)} tracks contain measurements of a vehicle; at least {FEWEST_TRACKS} are "
            "required, as intervals rest on the differences between tracks.",
            "Log more vehicles. A track starts where the sensor first sees a vehicle, and ends "
            "where it loses it.",
        )
    log = SensorLog(
        track=np.repeat(np.arange(len(parts)), [len(part.error_m) for part in parts]),
        follows=np.concatenate([part.follows for part in parts]),
        distance_m=np.concatenate([part.distance_m for part in parts]),
        speed_mps=np.concatenate([part.speed_mps for part in parts]),
        error_m=np.concatenate([part.error_m for part in parts]),
        step_s=step_s,
        tracks=len(parts),
        missed=sum(part.missed for part in everything),
        misses=sum(part.misses for part in everything),
        ghosts=ghosts,
    )
    _refuse_uninformative(log)
    return log


def _refuse_uninformative(log: SensorLog) -> None:
    """Refuse a log from which a parameter cannot be told.

    Raises:
        InvalidValue: few measurements are one step apart, or the distances or the errors of an axis
            are all equal.
    """
    consecutive = float(log.follows.mean())
    if consecutive < LEAST_CONSECUTIVE:
        raise InvalidValue(
            "time_s",
            f"only {100.0 * consecutive:.3g} % of the measurements come one step of "
            f"{log.step_s:g} s after another of their track.",
            "Give times in seconds. If the sensor is slower, give its period as --step.",
        )
    for name, distance in zip(("dx_m", "dy_m"), log.distance_m.T, strict=True):
        if np.ptp(distance) < LEAST_RANGE_M:
            raise InvalidValue(
                name,
                f"all distances are about {float(distance.mean()):.3g} m, so that it cannot be "
                "told how errors grow with the distance.",
                "Log vehicles at different distances along the road, and in other lanes.",
            )
    for name, error in zip(("seen_dx_m", "seen_dy_m"), log.error_m.T, strict=True):
        if not np.ptp(error):
            raise InvalidValue(
                name,
                f"all errors are {float(error[0]):.3g} m.",
                "Give the position that the sensor reported, not the true one.",
            )


class _Part(NamedTuple):
    """What a track adds to a log; see `SensorLog`."""

    follows: NDArray[np.bool_]
    distance_m: Array
    speed_mps: Array
    error_m: Array
    missed: int
    misses: int


def _measure_track(name: str, rows: Sequence[Row], step_s: float) -> _Part:
    rows = sorted(rows, key=lambda row: row.time_s)
    steps = _count_steps(name, np.array([row.time_s for row in rows]), step_s)
    positions = np.array([row.positions for row in rows])
    true, seen = positions[:, TRUE], positions[:, SEEN]
    is_seen = ~np.isnan(seen[:, 0])
    speed = np.full_like(true, nan)
    speed[1:] = np.diff(true, axis=0) / (np.diff(steps)[:, None] * step_s)
    is_next = np.zeros(len(rows), bool)
    is_next[1:] = (np.diff(steps) == 1) & is_seen[:-1]
    begins = ~is_seen & np.concatenate([[True], is_seen[:-1]])
    return _Part(
        follows=is_next[is_seen],
        distance_m=np.abs(true[is_seen]),
        speed_mps=speed[is_seen],
        error_m=(seen - true)[is_seen],
        missed=int((~is_seen).sum()),
        misses=int(begins.sum()),
    )


def _count_steps(name: str, time_s: Array, step_s: float) -> Integers:
    """Return the number of each measurement's step, from that of the first.

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


def _parse(values: Mapping[str, object], name: str, line: int) -> Row:
    """Return a row of a table.

    Raises:
        InvalidValue: a value is missing, or no number.
    """
    track = values["track"]
    if track is None or track == "" or track != track:  # noqa: PLR0124 - NaN is an empty value
        raise InvalidValue(f"{name}, row {line}: track", "is empty.", "Name the vehicle.")
    time_s = _parse_number(values["time_s"], f"{name}, row {line}: time_s")
    positions = [_parse_number(values[one], f"{name}, row {line}: {one}") for one in POSITIONS]
    for one in (TRUE, SEEN):
        if isnan(positions[one][0]) != isnan(positions[one][1]):
            raise InvalidValue(
                f"{name}, row {line}",
                f"only one of {' and '.join(POSITIONS[one])} is given.",
                "Give both, or leave both empty.",
            )
    if isnan(time_s):
        raise InvalidValue(f"{name}, row {line}: time_s", "is empty.", "Give a time in seconds.")
    return Row(str(track), time_s, tuple(positions))


def _parse_number(value: object, field: str) -> float:
    """Return a finite number, or NaN for an empty value."""
    if value is None or value == "" or value != value:  # noqa: PLR0124 - NaN is an empty value
        return nan
    try:
        number = float(str(value))
    except ValueError:
        number = nan
    if not isfinite(number):
        remedy = "Correct it, or leave the field empty where there is no measurement."
        raise InvalidValue(field, f"'{value}' is not a finite number.", remedy)
    return number


def _read_csv(file: Path) -> Iterator[tuple[int, Mapping[str, object]]]:
    try:
        with file.open(encoding="utf-8-sig", newline="") as text:
            table = csv.DictReader(text)
            _check_columns(table.fieldnames or (), file.name)
            for values in table:
                yield table.line_num, values
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise _make_unreadable(file, error) from error


def _read_parquet(file: Path) -> Iterator[tuple[int, Mapping[str, object]]]:
    try:
        import pyarrow.parquet
    except ModuleNotFoundError as error:
        raise InvalidValue(
            file.name, "Parquet needs pyarrow.", "Install eigenfail[export], or give CSV."
        ) from error
    try:
        schema = pyarrow.parquet.read_schema(file)
        _check_columns(schema.names, file.name)
        table = pyarrow.parquet.read_table(file, columns=list(COLUMNS))
    except (OSError, pyarrow.ArrowException) as error:
        raise _make_unreadable(file, error) from error
    columns = [table[name].to_pylist() for name in COLUMNS]
    for row, values in enumerate(zip(*columns, strict=True), 1):
        yield row, dict(zip(COLUMNS, values, strict=True))


def _check_columns(given: Sequence[str], name: str) -> None:
    """Refuse a table that lacks a column."""
    if missing := [column for column in COLUMNS if column not in given]:
        known = f"its columns are {', '.join(given)}" if given else "it has none"
        raise InvalidValue(
            name,
            f"columns {', '.join(missing)} are missing; {known}.",
            f"The first line of a CSV file names the columns, with commas between them: "
            f"{', '.join(COLUMNS)}.",
        )


def _make_unreadable(file: Path, error: Exception) -> InvalidValue:
    why = getattr(error, "strerror", None) or str(error)
    return InvalidValue(file.name, f"cannot be read: {why}.", "Name a file of CSV or Parquet.")
