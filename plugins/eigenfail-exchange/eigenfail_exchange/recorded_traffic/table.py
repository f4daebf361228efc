"""Tracks from a table with a row for each vehicle and time: CSV and Parquet."""

from collections.abc import Mapping
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from eigenfail.errors import InvalidValue
from eigenfail.files import read_table
from eigenfail.values.disturbance import Doubles
from eigenfail_exchange.recorded_traffic.columns import (
    COLUMNS,
    OPTIONAL,
    REMEDY,
    USUAL_SIZE_M,
    RecordedFile,
    Track,
    list_names,
    refuse_impossible,
)


def read_table_of_tracks(path: Path) -> RecordedFile:
    """Return the vehicles of CSV or Parquet."""
    table = read_table(path, COLUMNS)
    text, rows = np.array(table.text, np.int64), np.array(table.rows, np.int64)
    columns = {name: np.array(values) for name, values in table.numbers.items()}
    for name in COLUMNS.required:
        if (empty := np.isnan(columns[name])).any():
            row = rows[int(np.argmax(empty))]
            raise InvalidValue(f"{path.name}, row {row}: {name}", "is empty.", REMEDY)
    order = np.lexsort((columns["time_s"], text))
    bounds = np.searchsorted(text[order], np.arange(len(table.texts) + 1))
    tracks: dict[str, Track] = {}
    lacking: dict[str, list[str]] = {}
    for name, (first, last) in zip(table.texts, pairwise(bounds.tolist()), strict=True):
        tracks[name], incomplete = _make_track(columns, order[first:last])
        for column in incomplete:
            lacking.setdefault(column, []).append(name)
        refuse_impossible(name, tracks[name])
    notes = [f"Columns that are not read: {list_names(table.unread)}."] if table.unread else []
    for column, names in lacking.items():
        source = "is that of other rows" if column in USUAL_SIZE_M else "follows from positions"
        notes.append(f"{column} of {list_names(names)} {source}: some rows lack it.")
    return RecordedFile(tracks, {}, tuple(notes))


def _make_track(
    columns: Mapping[str, Doubles], order: NDArray[np.int64]
) -> tuple[Track, list[str]]:
    """Return the columns of a vehicle, and the names of OPTIONAL columns that lack some values.

    If some rows lack a size, they get the median size. Headings and speeds with missing values are
    dropped.
    """
    track = {column: values[order] for column, values in columns.items()}
    incomplete = []
    for column in OPTIONAL:
        if column not in track or not (empty := np.isnan(track[column])).any():
            continue
        if not empty.all():
            incomplete.append(column)
        if empty.all() or column not in USUAL_SIZE_M:
            del track[column]
        else:
            track[column][empty] = np.median(track[column][~empty])
    return track, incomplete
