"""Tracks of the obstacles of CommonRoad XML."""

from collections.abc import Iterable, Iterator, Sequence
from math import isfinite
from pathlib import Path
from xml.etree import ElementTree as ET
from xml.etree.ElementTree import Element

import numpy as np

from eigenfail.errors import InvalidValue
from eigenfail.files import open_regular
from eigenfail_exchange.recorded_traffic.columns import (
    RecordedFile,
    Track,
    list_names,
    refuse_impossible,
)

MOST_XML_BYTES = 500_000_000

VERSIONS = ("2018b", "2020a")
"""Versions of CommonRoad that are read."""


def read_commonroad(path: Path) -> RecordedFile:
    """Return the obstacles of CommonRoad XML that have exact states and a rectangle."""
    try:
        with open_regular(path, MOST_XML_BYTES) as file:
            root = ET.parse(file).getroot()  # noqa: S314 - a file of the user, in a process of the user
    except OSError as error:
        raise InvalidValue("tracks", f"{path} cannot be read: {error.strerror}.") from error
    except (ET.ParseError, LookupError, ValueError) as error:
        problem = f"{path} cannot be read: it is not XML ({error})."
        raise InvalidValue("tracks", problem, "Write it with commonroad-io.") from error
    for each in root.iter():
        each.tag = each.tag.rpartition("}")[2]
    step_s = _read_head(path, root)
    obstacles = [each for each in root if each.tag in OBSTACLES]
    states, left_out = _read_obstacles(path, obstacles, step_s)
    _stretch_static(obstacles, states, step_s)
    tracks = {name: _align_states(own) for name, own in states.items()}
    for name, track in tracks.items():
        refuse_impossible(name, track)
    notes = [*_list_unread(root, obstacles)]
    for column in ("heading_rad", "speed_mps"):
        lacking = [
            name
            for name, own in states.items()
            if column not in tracks[name] and any(column in state for state in own)
        ]
        if lacking:
            notes.append(
                f"{column} of {list_names(lacking)} follows from positions: some states lack it."
            )
    return RecordedFile(tracks, left_out, tuple(notes))


States = dict[str, list[dict[str, float]]]
"""States of each obstacle, by its name."""


def _read_obstacles(
    path: Path, obstacles: Iterable[Element], step_s: float
) -> tuple[States, dict[str, str]]:
    """Return the states of the obstacles, and why the others cannot be used."""
    states: States = {}
    left_out: dict[str, str] = {}
    for each in obstacles:
        name = each.get("id", "")
        if name in states or name in left_out:
            problem = f"{path.name} has two obstacles of the id '{name}'."
            raise InvalidValue("tracks", problem, "Give each an id of its own.")
        try:
            states[name] = _list_states(each, step_s)
        except ValueError as error:
            left_out[name] = f"{error}."
    return states, left_out


def _stretch_static(obstacles: Iterable[Element], states: States, step_s: float) -> None:
    """Let static obstacles stand during the whole recording, whatever the time of their state."""
    times = [state["time_s"] for own in states.values() for state in own]
    ends = (min(times), max(times)) if len(set(times)) > 1 else (0.0, step_s)
    for each in obstacles:
        name = each.get("id", "")
        if _is_static(each) and name in states:
            states[name] = [{**states[name][0], "time_s": end_s} for end_s in ends]


OBSTACLES = ("dynamicObstacle", "staticObstacle", "obstacle", "phantomObstacle")

STATE_PARTS = ("position", "orientation", "time", "velocity")

OBSTACLE_PARTS = ("role", "shape", "initialState", "trajectory")

DESCRIPTION = ("benchmarkID", "date", "author", "affiliation", "source")

HEAD = ("timeStepSize", "commonRoadVersion")


def _read_head(path: Path, root: Element) -> float:
    """Return the duration of a step. [s]

    Raises:
        InvalidValue: it is missing or impossible, or the file is of another kind or version.
    """
    remedy = f"Write it with commonroad-io, version {' or '.join(VERSIONS)}."
    if root.tag != "commonRoad":
        problem = f"{path} cannot be read: it is not CommonRoad XML, but has <{root.tag}>."
        raise InvalidValue("tracks", problem, remedy)
    version = root.get("commonRoadVersion", VERSIONS[-1])
    if version not in VERSIONS:
        problem = f"{path} cannot be read: its version of CommonRoad is '{version}'."
        raise InvalidValue("tracks", problem, remedy)
    try:
        step_s = float(root.get("timeStepSize", ""))
    except ValueError:
        step_s = 0.0
    if not 1e-3 <= step_s <= 10.0:
        problem = (
            f"{path} cannot be read: timeStepSize is '{root.get('timeStepSize', '')}', and must be "
            "between 0.001 and 10 s."
        )
        raise InvalidValue("tracks", problem, remedy)
    return step_s


def _is_static(obstacle: Element) -> bool:
    role = (obstacle.findtext("role") or "").strip()
    return obstacle.tag == "staticObstacle" or role == "static"


def _list_unread(root: Element, obstacles: Iterable[Element]) -> Iterator[str]:
    """Yield the parts of a CommonRoad file that are not read, in sentences."""
    counts: dict[str, int] = {}
    for each in root:
        if each.tag not in OBSTACLES:
            counts[each.tag] = counts.get(each.tag, 0) + 1
    for problem in root.findall("planningProblem"):
        yield (
            f"planningProblem '{problem.get('id')}' is not read: the ego is one of the obstacles, "
            "and starts where that was recorded."
        )
    counts.pop("planningProblem", None)
    if counts:
        listed = ", ".join(f"{tag} ({count})" for tag, count in sorted(counts.items()))
        yield f"Elements that are not read: {listed}. The road is that of the scenario's class."
    parts: set[str] = set(root.attrib) - {*DESCRIPTION, *HEAD}
    for each in obstacles:
        parts |= {part.tag for part in each} - set(OBSTACLE_PARTS)
        parts |= set(each.attrib) - {"id"}
        for state in _find_states(each):
            parts |= {part.tag for part in state} - set(STATE_PARTS)
    if parts:
        yield f"Parts of obstacles that are not read: {', '.join(sorted(parts))}."


def _find_states(obstacle: Element) -> list[Element]:
    return [*obstacle.findall("initialState"), *obstacle.findall("trajectory/state")]


def _list_states(obstacle: Element, step_s: float) -> list[dict[str, float]]:
    """Return the states of an obstacle; of a static one its only state.

    Raises:
        ValueError: it cannot be used, with the reason.
    """
    shape = obstacle.find("shape/rectangle")
    if shape is None or any(
        float(text)
        for path in ("originXShift", "originYShift", "orientation", "center/x", "center/y")
        if (text := shape.findtext(path))
    ):
        raise ValueError("It has no rectangle at its position")
    size = {"length_m": _read_float(shape, "length"), "width_m": _read_float(shape, "width")}
    if _is_static(obstacle):
        (state,) = obstacle.findall("initialState") or [Element("initialState")]
        time = {"time_s": 0.0, "speed_mps": 0.0}
        return [{**time, **_read_place(state), **size}]
    if obstacle.find("trajectory") is None:
        raise ValueError("It is not static, and has no trajectory")
    return [
        {"time_s": step_s * _read_float(state, "time/exact"), **_read_place(state), **size}
        for state in _find_states(obstacle)
    ]


def _read_place(state: Element) -> dict[str, float]:
    """Return place, heading and speed of a state; the last two only if it has them."""
    given = {"heading_rad": "orientation", "speed_mps": "velocity"}
    return {
        "x_m": _read_float(state, "position/point/x"),
        "y_m": _read_float(state, "position/point/y"),
        **{
            name: _read_float(state, f"{tag}/exact")
            for name, tag in given.items()
            if state.find(tag) is not None
        },
    }


def _align_states(states: Sequence[dict[str, float]]) -> Track:
    """Return columns of states in order of time; those that a state lacks are left to positions."""
    ordered = sorted(states, key=lambda state: state["time_s"])
    shared = [name for name in ordered[0] if all(name in state for state in ordered)]
    return {name: np.array([state[name] for state in ordered]) for name in shared}


def _read_float(parent: Element, path: str) -> float:
    text = parent.findtext(path)
    if text is None:
        raise ValueError(f"It has no {path} in {parent.tag}, and only exact values are read")
    value = float(text)
    if not isfinite(value):
        raise ValueError(f"Its {path} is {text}")
    return value
