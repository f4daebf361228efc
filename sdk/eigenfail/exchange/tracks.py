"""Recorded tracks of vehicles from CSV, Parquet and CommonRoad XML, on one time grid."""

import csv
from collections.abc import Iterable, Iterator, Mapping
from math import cos, isfinite, sin
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree as ET
from xml.etree.ElementTree import Element

import msgspec
import numpy as np

from eigenfail.errors import InvalidValue
from eigenfail.values.disturbance import Doubles
from eigenfail.values.showing import Brief

REQUIRED = ("id", "time_s", "x_m", "y_m")
OPTIONAL = ("heading_rad", "speed_mps", "length_m", "width_m")


USUAL_SIZE_M = {"length_m": 5.0, "width_m": 2.0}
"""Size of a vehicle whose track has none."""


STANDING_MPS = 0.1
"""Below this speed a direction does not follow from two positions. [m/s]"""


REMEDY = f"A track has the columns {', '.join(REQUIRED)}, and perhaps {', '.join(OPTIONAL)}."

Row = Mapping[str, Any]


class RoadFrame(msgspec.Struct, frozen=True):
    """Where a straight road is in the coordinates of a recording.

    Attributes:
        x_m: x of a point on the centre of lane 0, which becomes the origin.
        y_m: y of that point.
        heading_rad: direction of the road.
    """

    x_m: float = 0.0
    y_m: float = 0.0
    heading_rad: float = 0.0


AS_RECORDED = RoadFrame()


class RecordedTracks(Brief, msgspec.Struct, frozen=True, eq=False):
    """Vehicles that were recorded, at equal steps of time.

    Attributes:
        dt_s: time between two steps.
        ids: the name of each vehicle in the recording; the first is the ego.
        states: x [m], y [m], heading [rad], speed [m/s], shape (steps + 1, vehicles, 4).
        sizes: length and width [m], shape (vehicles, 2).
        left_out: names of vehicles that were not there all the time, or could not be read.
    """

    dt_s: float
    ids: tuple[str, ...]
    states: Doubles
    sizes: Doubles
    left_out: tuple[str, ...] = ()


def read_tracks(
    path: Path | str, ego: str, dt_s: float = 0.1, frame: RoadFrame = AS_RECORDED
) -> RecordedTracks:
    """Return the vehicles of a file that were there as long as the ego, interpolated to steps.

    The file has a row for each vehicle and time: `id`, `time_s`, `x_m` and `y_m` of its centre, and
    if they are known `heading_rad`, `speed_mps`, `length_m` and `width_m`. The road is along x, and
    y is to the left. Headings and speeds that are missing follow from the positions. Of CommonRoad
    XML (2020a) the dynamic obstacles with a trajectory and a rectangle are read; others with a
    trajectory are left out.

    Args:
        path: CSV; Parquet if its name ends in `.parquet`, CommonRoad if it ends in `.xml`.
        ego: id of the vehicle that a planner is to replace.
        dt_s: time between two steps.
        frame: where the road is in the file, if not along its x axis.

    Raises:
        InvalidValue: the file cannot be read, lacks a column or a number, or has no such vehicle,
            or no other one that is there as long.
    """
    path = Path(path)
    if not (isfinite(dt_s) and dt_s > 0.0):
        raise InvalidValue("dt_s", f"{dt_s} is not a positive number of seconds.")
    found, unreadable = _READERS.get(path.suffix.lower(), _read_csv)(path)
    rows = _group_rows(found)
    if ego in unreadable:
        problem = f"'{ego}' has no rectangle at its position, and cannot be replaced."
        raise InvalidValue("ego", problem)
    if ego not in rows:
        known = ", ".join(sorted(rows)[:20])
        raise InvalidValue("ego", f"'{ego}' is not in {path.name}.", f"It has {known}.")
    starts_s, ends_s = rows[ego]["time_s"][[0, -1]]
    # A little is added, since a whole number of steps may come out as slightly less.
    steps = int((ends_s - starts_s) / dt_s + 1e-6)
    if steps < 1:
        problem = f"Vehicle '{ego}' is recorded for {ends_s - starts_s:g} s, less than a step."
        raise InvalidValue("ego", problem)
    grid_s = starts_s + dt_s * np.arange(steps + 1)
    tolerance_s = 1e-6
    there = [
        name
        for name, track in rows.items()
        if track["time_s"][0] <= grid_s[0] + tolerance_s
        and track["time_s"][-1] >= grid_s[-1] - tolerance_s
    ]
    ids = (ego, *(name for name in there if name != ego))
    if len(ids) == 1:
        problem = f"No other vehicle of {path.name} is there as long as '{ego}'."
        raise InvalidValue("tracks", problem, "Cut the recording to a shorter time.")
    return RecordedTracks(
        dt_s=dt_s,
        ids=ids,
        states=_rotate_states(
            np.stack([_interpolate(rows[name], grid_s) for name in ids], axis=1), frame
        ),
        sizes=np.array([_find_size(rows[name]) for name in ids]),
        left_out=(*(name for name in rows if name not in ids), *unreadable),
    )


class _File(NamedTuple):
    """Rows of a file, and names of vehicles that it has in a form that is not read."""

    rows: list[Row]
    unreadable: tuple[str, ...] = ()


def _read_csv(path: Path) -> _File:
    try:
        with path.open(encoding="utf-8", newline="") as file:
            return _File(list(csv.DictReader(file)))
    except (OSError, UnicodeDecodeError, csv.Error) as error:
        problem = f"{path} cannot be read: {getattr(error, 'strerror', None) or error}."
        raise InvalidValue("tracks", problem, REMEDY) from error


def _read_parquet(path: Path) -> _File:
    from pyarrow import ArrowException
    from pyarrow.parquet import read_table

    try:
        return _File(read_table(path).to_pylist())
    except (OSError, ArrowException) as error:
        raise InvalidValue("tracks", f"{path} cannot be read: {error}.", REMEDY) from error


def _read_commonroad(path: Path) -> _File:
    try:
        root = ET.parse(path).getroot()  # noqa: S314 - a file of the user, in a process of the user
        step_s = float(root.attrib["timeStepSize"])
        moving = [
            each for each in root.iter("dynamicObstacle") if each.find("trajectory") is not None
        ]
        rows = [
            row for each in moving if _has_footprint(each) for row in _list_states(each, step_s)
        ]
        left_out = tuple(each.attrib["id"] for each in moving if not _has_footprint(each))
        return _File(rows, left_out)
    except OSError as error:
        raise InvalidValue("tracks", f"{path} cannot be read: {error.strerror}.") from error
    except (ET.ParseError, KeyError, ValueError, AttributeError) as error:
        problem = f"{path} cannot be read: it is not CommonRoad XML with exact states ({error})."
        raise InvalidValue(
            "tracks", problem, "Write it with commonroad-io, version 2020a."
        ) from error


def _has_footprint(vehicle: Element) -> bool:
    """Whether a dynamic obstacle is a rectangle with its centre at its position."""
    shape = vehicle.find("shape/rectangle")
    return shape is not None and not float(shape.findtext("originXShift", "0"))


def _list_states(vehicle: Element, step_s: float) -> Iterator[Row]:
    """Yield the states of a dynamic obstacle; raises ValueError where one is not exact."""
    shape, name = "shape/rectangle", vehicle.attrib["id"]
    for state in (*vehicle.findall("initialState"), *vehicle.findall("trajectory/state")):
        yield {
            "id": name,
            "time_s": step_s * _read_float(state, "time/exact"),
            "x_m": _read_float(state, "position/point/x"),
            "y_m": _read_float(state, "position/point/y"),
            "heading_rad": _read_float(state, "orientation/exact"),
            "speed_mps": _read_float(state, "velocity/exact"),
            "length_m": _read_float(vehicle, f"{shape}/length"),
            "width_m": _read_float(vehicle, f"{shape}/width"),
        }


def _read_float(parent: Element, path: str) -> float:
    text = parent.findtext(path)
    if text is None:
        raise ValueError(f"no {path} in {parent.tag}")
    return float(text)


_READERS = {".parquet": _read_parquet, ".xml": _read_commonroad}


def _rotate_states(states: Doubles, frame: RoadFrame) -> Doubles:
    """Return states in a frame in which the road is along x."""
    dx, dy = states[..., 0] - frame.x_m, states[..., 1] - frame.y_m
    c, s = cos(frame.heading_rad), sin(frame.heading_rad)
    heading, speed = states[..., 2] - frame.heading_rad, states[..., 3]
    return np.stack([c * dx + s * dy, c * dy - s * dx, heading, speed], axis=-1)


def _group_rows(rows: Iterable[Row]) -> dict[str, dict[str, Doubles]]:
    """Return the columns of each vehicle, in order of time."""
    by_vehicle: dict[str, list[Row]] = {}
    for number, row in enumerate(rows, start=1):
        missing = [name for name in REQUIRED if row.get(name) in (None, "")]
        if missing:
            raise InvalidValue("tracks", f"Row {number} has no {missing[0]}.", REMEDY)
        by_vehicle.setdefault(str(row["id"]), []).append(row)
    return {name: _make_columns(name, found) for name, found in by_vehicle.items()}


def _make_columns(name: str, rows: list[Row]) -> dict[str, Doubles]:
    # A column that some rows have is used: where one lacks it, its number is refused.
    known = [each for each in OPTIONAL if any(row.get(each) not in (None, "") for row in rows)]
    used = [*REQUIRED[1:], *known]
    columns = {each: np.array([_read_number(name, each, row) for row in rows]) for each in used}
    order = np.argsort(columns["time_s"], kind="stable")
    columns = {each: values[order] for each, values in columns.items()}
    if (np.diff(columns["time_s"]) <= 0.0).any():
        raise InvalidValue("tracks", f"Vehicle '{name}' has two rows of one time.", REMEDY)
    return columns


def _read_number(name: str, column: str, row: Row) -> float:
    try:
        value = float(row[column])
    except (KeyError, TypeError, ValueError):
        value = float("nan")
    if not isfinite(value):
        problem = f"{column} of vehicle '{name}' is {row.get(column)!r}, and no finite number."
        raise InvalidValue("tracks", problem, REMEDY)
    return value


def _interpolate(track: Mapping[str, Doubles], grid_s: Doubles) -> Doubles:
    """Return x, y, heading and speed at the times of a grid, shape (times, 4)."""
    time_s = track["time_s"]
    x_m, y_m = (np.interp(grid_s, time_s, track[name]) for name in ("x_m", "y_m"))
    along, across = np.gradient(x_m, grid_s), np.gradient(y_m, grid_s)
    moved_mps = np.hypot(along, across)
    speed = np.interp(grid_s, time_s, track["speed_mps"]) if "speed_mps" in track else moved_mps
    if "heading_rad" in track:
        heading = np.interp(grid_s, time_s, np.unwrap(track["heading_rad"]))
    else:
        heading = _hold_direction(np.arctan2(across, along), moved_mps > STANDING_MPS)
    return np.stack([x_m, y_m, heading, speed], axis=1)


def _hold_direction(heading: Doubles, moves: np.ndarray[Any, Any]) -> Doubles:
    """Return the headings, with that of the nearest time of motion while a vehicle stands."""
    moving = np.flatnonzero(moves)
    if not len(moving):
        return np.zeros_like(heading)
    steps = np.arange(len(heading))
    after = np.searchsorted(moving, steps).clip(max=len(moving) - 1)
    before = np.maximum(after - 1, 0)
    is_before_nearer = steps - moving[before] <= moving[after] - steps
    # Turns are counted over the moving steps alone: a vehicle that stands has no direction.
    turned = np.unwrap(heading[moving])
    return np.asarray(turned[np.where(is_before_nearer, before, after)], np.float64)


def _find_size(track: Mapping[str, Doubles]) -> tuple[float, float]:
    length_m, width_m = (
        float(np.median(track[name])) if name in track else usual
        for name, usual in USUAL_SIZE_M.items()
    )
    return length_m, width_m
