"""Reads the log of a sensor from a table of CSV or Parquet."""

import csv
from collections.abc import Iterator, Mapping, Sequence
from math import isfinite, isnan, nan
from pathlib import Path

from eigenfail.errors import InvalidValue
from eigenfail_services.noise_fit.sensor_log import (
    MEASURED,
    POSITION_COLUMNS,
    SEEN,
    TRUE,
    Row,
    SensorLog,
    make_log,
    name_columns,
)

COLUMNS = {
    "track": "name or number of one vehicle from when the sensor first saw it until it lost it",
    "time_s": "time of the measurement [s]",
    "dx_m": "true position of the vehicle's centre from the ego's, along the road [m]",
    "dy_m": "the same across the road, positive to the left [m]",
    "seen_dx_m": "position that the sensor reported, along the road [m]; empty where it missed",
    "seen_dy_m": "the same across the road [m]; empty where it missed",
}
"""Columns that a log must have, in any order. Others are ignored."""

POSITIONS = (*POSITION_COLUMNS, *(f"seen_{column}" for column in POSITION_COLUMNS))


def read_log(file: Path, step_s: float) -> SensorLog:
    """Read a log of CSV, or of Parquet where pyarrow is installed.

    Args:
        file: table with the columns `COLUMNS`, and any pairs of columns of `MEASURED`.
        step_s: time between two measurements, which is that between two steps of a scenario. [s]

    Raises:
        InvalidValue: the file cannot be read, lacks a column, holds a value that is no number, has
            too few tracks, times that are not a whole number of steps apart, or distances that do
            not differ.
    """
    read = _read_parquet if file.suffix.lower() == ".parquet" else _read_csv
    quantities, values = read(file)
    rows = [_parse(value, quantities, f"{file.name}, row {line}") for line, value in values]
    if not rows:
        raise InvalidValue(file.name, "contains no rows.", "Give a row for each track and step.")
    return make_log(rows, step_s, quantities)


def _parse(values: Mapping[str, object], quantities: Sequence[str], where: str) -> Row:
    """Return a row of a table.

    Raises:
        InvalidValue: a value is missing, or no number; or there is a reported value where the
            sensor missed the vehicle.
    """
    track = values["track"]
    if track is None or track == "" or track != track:  # noqa: PLR0124 - NaN is an empty value
        raise InvalidValue(f"{where}: track", "is empty.", "Name the vehicle.")
    time_s = _parse_number(values["time_s"], f"{where}: time_s")
    positions = [_parse_number(values[one], f"{where}: {one}") for one in POSITIONS]
    for one in (TRUE, SEEN):
        if isnan(positions[one][0]) != isnan(positions[one][1]):
            raise InvalidValue(
                where,
                f"only one of {' and '.join(POSITIONS[one])} is given.",
                "Give both, or leave both empty.",
            )
    if isnan(time_s):
        raise InvalidValue(f"{where}: time_s", "is empty.", "Give a time in seconds.")
    others = []
    for quantity in quantities:
        true, seen = name_columns(quantity)
        pair = [_parse_number(values[one], f"{where}: {one}") for one in (true, seen)]
        if isnan(positions[2]) and not isnan(pair[1]):
            raise InvalidValue(
                f"{where}: {seen}",
                f"is given, and {POSITIONS[2]} is empty.",
                "Leave both empty where the sensor missed the vehicle.",
            )
        others += pair
    return Row(str(track), time_s, tuple(positions), tuple(others))


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


Values = Iterator[tuple[int, Mapping[str, object]]]


def _read_csv(file: Path) -> tuple[tuple[str, ...], Values]:
    """Return the quantities that a table has, and its values by line."""
    return _check_columns(_read_head(file), file.name), _list_lines(file)


def _read_head(file: Path) -> Sequence[str]:
    try:
        with file.open(encoding="utf-8-sig", newline="") as text:
            return csv.DictReader(text).fieldnames or ()
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise _make_unreadable(file, error) from error


def _list_lines(file: Path) -> Values:
    try:
        with file.open(encoding="utf-8-sig", newline="") as text:
            table = csv.DictReader(text)
            for values in table:
                yield table.line_num, values
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        raise _make_unreadable(file, error) from error


def _read_parquet(file: Path) -> tuple[tuple[str, ...], Values]:
    """Return the quantities that a table has, and its values by row."""
    try:
        import pyarrow.parquet
    except ModuleNotFoundError as error:
        raise InvalidValue(
            file.name, "Parquet needs pyarrow.", "Install eigenfail[export], or give CSV."
        ) from error
    try:
        schema = pyarrow.parquet.read_schema(file)
        quantities = _check_columns(schema.names, file.name)
        pairs = [column for quantity in quantities for column in name_columns(quantity)]
        names = [*COLUMNS, *pairs]
        table = pyarrow.parquet.read_table(file, columns=names)
    except (OSError, pyarrow.ArrowException) as error:
        raise _make_unreadable(file, error) from error
    columns = [table[name].to_pylist() for name in names]
    rows = (dict(zip(names, values, strict=True)) for values in zip(*columns, strict=True))
    return quantities, enumerate(rows, 1)


def _check_columns(given: Sequence[str], name: str) -> tuple[str, ...]:
    """Return the quantities that a table has besides the position.

    Raises:
        InvalidValue: it lacks a column, or the other one of a pair.
    """
    if missing := [column for column in COLUMNS if column not in given]:
        known = f"its columns are {', '.join(given)}" if given else "it has none"
        raise InvalidValue(
            name,
            f"columns {', '.join(missing)} are missing; {known}.",
            f"The first line of a CSV file names the columns, with commas between them: "
            f"{', '.join(COLUMNS)}.",
        )
    pairs = {quantity: name_columns(quantity) for quantity in MEASURED}
    for true, seen in pairs.values():
        if (true in given) != (seen in given):
            there, lacking = (true, seen) if true in given else (seen, true)
            raise InvalidValue(
                name,
                f"column {there} is given, and column {lacking} is missing.",
                f"Give {true} and {seen}, or neither.",
            )
    return tuple(quantity for quantity, (true, _) in pairs.items() if true in given)


def _make_unreadable(file: Path, error: Exception) -> InvalidValue:
    why = getattr(error, "strerror", None) or str(error)
    return InvalidValue(file.name, f"cannot be read: {why}.", "Name a file of CSV or Parquet.")
