"""Samples of scenario parameters that a campaign's file takes from a column of a CSV file."""

import csv
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from eigenfail.errors import InvalidValue, UnknownName
from eigenfail.values.variation import MOST_SAMPLES

PARAMETERS = "scenario_parameters"
SAMPLE, COLUMN = "empirical", "column"


def include_samples(fields: Mapping[str, Any], file: Path) -> dict[str, Any]:
    """Return the fields of a campaign, with samples in the place of the names of their files.

    Args:
        fields: as the file has them; a scenario parameter may be `{empirical = "gaps.csv", column =
            "gap_m"}`, with the path of a CSV file from the folder of this one.
        file: that they are from.

    Raises:
        UnknownName: the CSV file has no such column.
        InvalidValue: no column is named, the file cannot be read, a cell is not a number, or there
            are more than `MOST_SAMPLES`.
    """
    given = fields.get(PARAMETERS)
    if not isinstance(given, dict):
        return dict(fields)
    read = {
        name: _read_sample(value, file, f"{file.name}: {PARAMETERS}.{name}")
        if isinstance(value, dict) and isinstance(value.get(SAMPLE), str)
        else value
        for name, value in given.items()
    }
    return {**fields, PARAMETERS: read}


def _read_sample(given: Mapping[str, Any], file: Path, field: str) -> dict[str, list[float]]:
    """Return the distribution of a sample that a file holds."""
    path, column = file.parent / given[SAMPLE], given.get(COLUMN)
    if not isinstance(column, str) or len(given) > len((SAMPLE, COLUMN)):
        remedy = f'Write it as {{{SAMPLE} = "gaps.csv", {COLUMN} = "gap_m"}}.'
        raise InvalidValue(field, f"the column of '{given[SAMPLE]}' is not named.", remedy)
    try:
        with path.open(encoding="utf-8-sig", newline="") as text:
            rows = csv.DictReader(text)
            names = rows.fieldnames or ()
            if column not in names:
                raise UnknownName(f"{field}.{COLUMN}", column, names)
            cells = [(rows.line_num, row[column]) for row in rows]
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        problem = f"'{path}' cannot be read: {error}."
        raise InvalidValue(field, problem, "Name a CSV file with a header.") from None
    if len(cells) > MOST_SAMPLES:
        problem = f"'{path}' has {len(cells)} rows, and a sample at most {MOST_SAMPLES}."
        raise InvalidValue(field, problem, "Take a random part of them.")
    return {SAMPLE: [_read_number(cell, line, path, field) for line, cell in cells]}


def _read_number(cell: str | None, line: int, path: Path, field: str) -> float:
    try:
        return float(cell or "")
    except ValueError:
        problem = f"'{cell or ''}' in line {line} of '{path}' is not a number."
        raise InvalidValue(field, problem, "Remove the row, or correct it.") from None
