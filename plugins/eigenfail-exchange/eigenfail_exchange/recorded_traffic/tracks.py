"""Recorded tracks of vehicles from CSV, Parquet and CommonRoad XML, on one time grid.

Nothing of a file is dropped silently. A vehicle that cannot be used is left out by name, whatever
else is not read is noted, and columns that contradict each other are refused.
"""

from collections.abc import Iterable, Mapping, Sequence
from math import cos, isfinite, sin
from pathlib import Path

import msgspec
import numpy as np

from eigenfail.errors import InvalidValue, UnknownName
from eigenfail.values.disturbance import Doubles
from eigenfail.values.showing import Brief
from eigenfail_exchange.recorded_traffic.columns import (
    MOST_NAMED,
    REMEDY,
    USUAL_SIZE_M,
    RecordedFile,
    Track,
    list_names,
)
from eigenfail_exchange.recorded_traffic.commonroad import read_commonroad
from eigenfail_exchange.recorded_traffic.cuts import (
    LONGEST_GAP_S,
    cut_tracks,
    find_parts,
    refuse_units_of_time,
)
from eigenfail_exchange.recorded_traffic.headings import check_headings, check_unit_of_headings
from eigenfail_exchange.recorded_traffic.motion import interpolate
from eigenfail_exchange.recorded_traffic.speeds import flip_speeds, refuse_other_speeds
from eigenfail_exchange.recorded_traffic.table import read_table_of_tracks

FARTHEST_OF_ROAD_M = 1e5
"""Places of scenes are of single precision: beyond this they are rounded to more than 4 mm. [m]"""


MOST_STEPS = 10_000
"""Longest episode, as of bridges."""


MOST_VEHICLES = 999
"""Channels name vehicles up to this number."""


class RoadFrame(msgspec.Struct, frozen=True):
    """Position and direction of a straight road in the coordinates of a recording.

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
        ids: the name of each vehicle in the recording; the first is the ego. Those that are there
            at the start come before the others.
        states: x [m], y [m], heading [rad], speed [m/s], shape (steps + 1, vehicles, 4); NaN while
            a vehicle is not there. It comes and goes once at most.
        sizes: length and width [m], shape (vehicles, 2).
        left_out: vehicles of the recording that no episode has, by name, with the reason.
        notes: what else of the file was not used or was changed, in sentences.
    """

    dt_s: float
    ids: tuple[str, ...]
    states: Doubles
    sizes: Doubles
    left_out: Mapping[str, str] = {}
    notes: tuple[str, ...] = ()


def read_tracks(  # noqa: PLR0913 - each argument is a choice of the user
    path: Path | str,
    ego: str | int,
    dt_s: float = 0.1,
    frame: RoadFrame = AS_RECORDED,
    *,
    longest_gap_s: float = LONGEST_GAP_S,
    without: Iterable[str | int] = (),
) -> RecordedTracks:
    """Return the vehicles of a file during the time of the ego, interpolated to steps.

    The file has a row for each vehicle and time: `id`, `time_s`, `x_m` and `y_m` of its centre, and
    if they are known `heading_rad`, `speed_mps`, `length_m` and `width_m`. The road is along x, and
    y is to the left. Headings and speeds that are missing follow from the positions. From
    CommonRoad XML (2018b or 2020a), obstacles with exact states and a rectangle are read; static
    ones stand all the time.

    A vehicle that is lost for longer than `longest_gap_s` while it moves, or that jumps, ends
    there: what comes after is another vehicle, named `ID, part 2`.

    Args:
        path: CSV; Parquet if its name ends in `.parquet`, CommonRoad if it ends in `.xml`.
        ego: id of the vehicle that a planner is to replace.
        dt_s: time between two steps.
        frame: position of the road in the file, if it is not along the file's x axis.
        longest_gap_s: longest time between two rows of a vehicle that is interpolated.
        without: ids of vehicles to leave out on purpose.

    Raises:
        UnknownName: a vehicle in `without` is not in the file.
        InvalidValue: the file cannot be read, lacks a column or a number, or contradicts itself;
            the ego does not exist, cannot be used, or has more steps than an episode can have; or
            there is a time at which no other vehicle is there.
    """
    path = Path(path)
    _refuse_arguments(dt_s, longest_gap_s, without)
    ego = str(ego)
    read = read_commonroad if path.suffix.lower() == ".xml" else read_table_of_tracks
    found = read(path)
    unwanted = set(map(str, without))
    for name in unwanted:
        if name not in found.tracks and name not in found.left_out:
            raise UnknownName("without", name, (*found.tracks, *found.left_out))
    kept = {name: track for name, track in found.tracks.items() if name not in unwanted}
    left_out = {name: why for name, why in found.left_out.items() if name not in unwanted}
    refuse_units_of_time(kept, longest_gap_s)
    parts, cuts, single = cut_tracks(kept, longest_gap_s, left_out)
    notes = [
        f"'{name}' {why}. Its parts are vehicles of their own: "
        f"{list_names(find_parts(parts, name))}."
        for name, why in cuts.items()
    ]
    notes += single
    track = _find_ego(path, ego, parts, cuts, RecordedFile(kept, left_out, (*found.notes, *notes)))
    for name, part in [*parts.items()]:
        notes += check_headings(name, part, is_ego=name == ego)
        parts[name], flipped = flip_speeds(name, part)
        notes += flipped
        refuse_other_speeds(name, part)
    notes += check_unit_of_headings(parts)
    grid_s = _make_grid(ego, track, dt_s)
    spans = {name: _find_span(part, grid_s) for name, part in parts.items()}
    ids, never = _choose_vehicles(path, ego, spans)
    if never:
        notes.append(f"Not there for a step of the time of '{ego}' at least: {list_names(never)}.")
    states = np.full((len(grid_s), len(ids), 4), np.nan)
    for number, name in enumerate(ids):
        first, last = spans[name]
        own_s = grid_s[first : last + 1]
        course = interpolate(parts[name], own_s)
        # A vehicle that never moves, and has no headings, points along the road.
        course[np.isnan(course[:, 2]), 2] = frame.heading_rad
        states[first : last + 1, number] = course
    _refuse_empty_road(path, ego, states, grid_s, [*_explain_left_out(left_out), *notes])
    states = _rotate_states(states, frame)
    _refuse_far_places(ids, states)
    return RecordedTracks(
        dt_s=dt_s,
        ids=ids,
        states=states,
        sizes=np.array([_find_size(parts[name]) for name in ids]),
        left_out=left_out,
        notes=(*found.notes, *notes),
    )


def _refuse_arguments(dt_s: float, longest_gap_s: float, without: Iterable[str | int]) -> None:
    """Refuse impossible durations, and a text in place of a list of ids: its letters would be ids.

    Raises:
        InvalidValue: they are.
    """
    if not (isfinite(dt_s) and dt_s > 0.0):
        raise InvalidValue("dt_s", f"{dt_s} is not a positive number of seconds.")
    if not longest_gap_s > 0.0:
        problem = f"{longest_gap_s} is not a positive number of seconds."
        raise InvalidValue("longest_gap_s", problem)
    if isinstance(without, str):
        raise InvalidValue("without", f"'{without}' is a text.", f"Give a list: ['{without}'].")


def _choose_vehicles(
    path: Path, ego: str, spans: Mapping[str, tuple[int, int]]
) -> tuple[tuple[str, ...], list[str]]:
    """Return the names of the ego and the others in the order of their numbers, and of the rest.

    Raises:
        InvalidValue: there are more than have numbers.
    """
    never = [name for name, (first, last) in spans.items() if last <= first]
    others = [name for name in spans if name != ego and name not in set(never)]
    if len(others) > MOST_VEHICLES:
        problem = (
            f"{path.name} has {len(others):,} vehicles beside '{ego}', and an episode at most "
            f"{MOST_VEHICLES}."
        )
        raise InvalidValue("tracks", problem, "Cut the recording to a shorter time.")
    # Those that are there at the start are the actors of a scenario, with the first numbers.
    others.sort(key=lambda name: spans[name][0] > 0)
    return (ego, *others), never


def _find_ego(
    path: Path, ego: str, parts: Mapping[str, Track], cuts: Mapping[str, str], found: RecordedFile
) -> Track:
    """Return the track of the ego.

    Raises:
        InvalidValue: the vehicle does not exist, or cannot be used.
    """
    if ego in parts:
        return parts[ego]
    if ego in found.left_out:
        problem = f"'{ego}' cannot be used. {found.left_out[ego]}"
        raise InvalidValue("ego", problem, "Choose another vehicle.")
    if ego in cuts:
        remedy = f"Choose a part of it: {list_names(find_parts(parts, ego))}."
        raise InvalidValue("ego", f"'{ego}' {cuts[ego]}.", remedy)
    said = " ".join(found.notes)
    if not parts:
        reasons = " ".join(_explain_left_out(found.left_out))
        problem = f"{path.name} has no vehicle that can be used. {reasons} {said}".strip()
        raise InvalidValue("tracks", problem, REMEDY)
    known = list_names(sorted(parts))
    raise InvalidValue("ego", f"'{ego}' is not in {path.name}.", f"It has {known}. {said}".strip())


def _explain_left_out(left_out: Mapping[str, str]) -> list[str]:
    return [f"'{name}' is left out: {why}" for name, why in [*left_out.items()][:MOST_NAMED]]


def _make_grid(ego: str, track: Track, dt_s: float) -> Doubles:
    """Return the times of the steps, from the first time of the ego to its last. [s]

    Raises:
        InvalidValue: they are less than a step apart, or more steps than an episode can have.
    """
    starts_s, ends_s = track["time_s"][[0, -1]].tolist()
    lasts_s = ends_s - starts_s
    if not lasts_s / dt_s <= MOST_STEPS + 0.5:
        problem = (
            f"Vehicle '{ego}' is recorded for {lasts_s:g} s, which are {lasts_s / dt_s:.4g} steps "
            f"of {dt_s:g} s. An episode has at most {MOST_STEPS:,}."
        )
        remedy = "Cut the recording, or choose a larger dt_s. `time_s` is in seconds."
        raise InvalidValue("time_s", problem, remedy)
    # A little is added, since a whole number of steps may come out as slightly less.
    steps = int(lasts_s / dt_s + 1e-6)
    if steps < 1:
        problem = f"Vehicle '{ego}' is recorded for {lasts_s:g} s, less than a step."
        raise InvalidValue("ego", problem)
    return np.asarray(starts_s + dt_s * np.arange(steps + 1), np.float64)


def _find_span(track: Track, grid_s: Doubles) -> tuple[int, int]:
    """Return the first and the last step at which a vehicle is there."""
    tolerance_s = 1e-6
    first = int(np.searchsorted(grid_s, track["time_s"][0] - tolerance_s))
    last = int(np.searchsorted(grid_s, track["time_s"][-1] + tolerance_s, "right")) - 1
    return first, last


def _refuse_empty_road(
    path: Path, ego: str, states: Doubles, grid_s: Doubles, reasons: Iterable[str]
) -> None:
    """Refuse a recording if the ego is alone at some time.

    Raises:
        InvalidValue: it is.
    """
    alone = ~np.isfinite(states[:, 1:, 0]).any(axis=1)
    if not alone.any():
        return
    at_s, said = grid_s[int(np.argmax(alone))], " ".join(reasons)
    problem = f"No other vehicle of {path.name} is there beside '{ego}' at {at_s:g} s. {said}"
    raise InvalidValue("tracks", problem.strip(), "Cut the recording to a shorter time.")


def _rotate_states(states: Doubles, frame: RoadFrame) -> Doubles:
    """Return states in a frame whose x axis is along the road."""
    dx, dy = states[..., 0] - frame.x_m, states[..., 1] - frame.y_m
    c, s = cos(frame.heading_rad), sin(frame.heading_rad)
    heading, speed = states[..., 2] - frame.heading_rad, states[..., 3]
    return np.stack([c * dx + s * dy, c * dy - s * dx, heading, speed], axis=-1)


def _refuse_far_places(ids: Sequence[str], states: Doubles) -> None:
    """Refuse places too far from the origin of the road to be kept in single precision.

    Raises:
        InvalidValue: there are some.
    """
    for number, name in enumerate(ids):
        far = np.abs(states[:, number, :2]) > FARTHEST_OF_ROAD_M
        if far.any():
            x_m, y_m = states[int(np.argmax(far.any(axis=1))), number, :2].tolist()
            problem = (
                f"Vehicle '{name}' is at x = {x_m:.0f} m, y = {y_m:.0f} m of the road, and at most "
                f"{FARTHEST_OF_ROAD_M:,.0f} m are kept."
            )
            remedy = "Give `frame`, the place of the road in the recording."
            raise InvalidValue("frame", problem, remedy)


def _find_size(track: Track) -> tuple[float, float]:
    length_m, width_m = (
        float(np.median(track[name])) if name in track else usual
        for name, usual in USUAL_SIZE_M.items()
    )
    return length_m, width_m
