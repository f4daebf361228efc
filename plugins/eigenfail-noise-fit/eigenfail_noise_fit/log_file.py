"""Reads the log of a sensor from a table of CSV or Parquet."""

from collections.abc import Mapping
from math import isnan, pi
from pathlib import Path

from eigenfail.errors import InvalidValue
from eigenfail.files import DataTable, TableColumns, read_table
from eigenfail_noise_fit import sensor_log

NUMBERS = (
    "time_s",
    *sensor_log.POSITION_COLUMNS,
    *(f"seen_{column}" for column in sensor_log.POSITION_COLUMNS),
)
PAIRS = {quantity: sensor_log.name_columns(quantity) for quantity in sensor_log.MEASURED}

COLUMNS = TableColumns(
    "track",
    NUMBERS,
    tuple(column for pair in PAIRS.values() for column in pair),
    f"A log has the columns track, {', '.join(NUMBERS)}, named in the first line of a CSV file. "
    "Times are in seconds and distances in metres; what was seen is empty where the sensor missed.",
)

POSITIONS = NUMBERS[1:]

MOST_TURNS_RAD = 2.0 * pi + 1e-3
MOST_DEGREES = 360.5
"""Directions are within a turn."""


def read_log(file: Path, step_s: float) -> sensor_log.SensorLog:
    """Read a log of CSV, or of Parquet if pyarrow is installed.

    Args:
        file: table with the columns `COLUMNS`, and any pairs of columns of `MEASURED`.
        step_s: time between two measurements, equal to the time between two steps of a scenario.
            [s]

    Raises:
        InvalidValue: the file cannot be read, lacks a column, or holds a value that is not a
            number. Also if it has too few tracks, times that are not a whole number of steps apart,
            distances that do not differ, or headings beyond a turn.
    """
    table = read_table(file, COLUMNS)
    quantities = _find_quantities(table.numbers, file.name)
    if not table.rows:
        raise InvalidValue(file.name, "contains no rows.", "Give a row for each track and step.")
    columns = {name: values.tolist() for name, values in table.numbers.items()}
    used = [column for quantity in quantities for column in PAIRS[quantity]]
    rows = []
    for place, (number, track) in enumerate(zip(table.rows, table.text, strict=True)):
        where = f"{file.name}, row {number}"
        positions = tuple(columns[name][place] for name in POSITIONS)
        others = tuple(columns[name][place] for name in used)
        time_s = columns["time_s"][place]
        _refuse_partial(where, time_s, positions, dict(zip(used, others, strict=True)))
        rows.append(sensor_log.Row(table.texts[track], time_s, positions, others))
    _refuse_degrees(table, file.name)
    return sensor_log.make_log(rows, step_s, quantities, table.unread)


def _refuse_partial(
    where: str, time_s: float, positions: tuple[float, ...], others: Mapping[str, float]
) -> None:
    """Refuse a row without a time, with half a position, or with values of a missed vehicle.

    Raises:
        InvalidValue: the row is such a row.
    """
    for one in (sensor_log.TRUE, sensor_log.SEEN):
        if isnan(positions[one][0]) != isnan(positions[one][1]):
            raise InvalidValue(
                where,
                f"only one of {' and '.join(POSITIONS[one])} is given.",
                "Give both, or leave both empty.",
            )
    if isnan(time_s):
        raise InvalidValue(f"{where}: time_s", "is empty.", "Give a time in seconds.")
    for name, value in others.items():
        if name.startswith("seen_") and isnan(positions[2]) and not isnan(value):
            raise InvalidValue(
                f"{where}: {name}",
                f"is given, and {POSITIONS[2]} is empty.",
                "Leave both empty where the sensor missed the vehicle.",
            )


def _refuse_degrees(table: DataTable, name: str) -> None:
    """Refuse headings too large to be directions in radians.

    Raises:
        InvalidValue: one is beyond a turn.
    """
    for column in PAIRS["heading"]:
        for row, value in zip(table.rows, table.numbers.get(column, ()), strict=False):
            if abs(value) > MOST_TURNS_RAD:
                seems = "The headings seem to be in degrees."
                if abs(value) > MOST_DEGREES:
                    seems = "It seems to mean that there is no measurement."
                raise InvalidValue(
                    f"{name}, row {row}: {column}",
                    f"{value:g} is beyond a turn, 2π. {seems}",
                    "Give radians, or leave the field empty where there is no measurement.",
                )


def _find_quantities(given: Mapping[str, object], name: str) -> tuple[str, ...]:
    """Return the quantities that a table has besides the position.

    Raises:
        InvalidValue: it has only one column of a pair.
    """
    for true, seen in PAIRS.values():
        if (true in given) != (seen in given):
            there, lacking = (true, seen) if true in given else (seen, true)
            raise InvalidValue(
                name,
                f"column {there} is given, and column {lacking} is missing.",
                f"Give {true} and {seen}, or neither.",
            )
    return tuple(quantity for quantity, (true, _) in PAIRS.items() if true in given)
