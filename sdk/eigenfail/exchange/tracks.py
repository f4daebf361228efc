"""Recorded tracks of vehicles from CSV, Parquet and CommonRoad XML, on one time grid.

Nothing of a file is dropped silently. A vehicle that cannot be used is left out by name, whatever
else is not read is noted, and columns that contradict each other are refused.
"""

from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from itertools import pairwise
from math import cos, isfinite, pi, sin
from pathlib import Path
from typing import Any, NamedTuple
from xml.etree import ElementTree as ET
from xml.etree.ElementTree import Element

import msgspec
import numpy as np
from numpy.typing import NDArray

from eigenfail.errors import InvalidValue, UnknownName
from eigenfail.files import TableColumns, open_regular, read_table
from eigenfail.values.disturbance import Doubles
from eigenfail.values.showing import Brief

REQUIRED = ("id", "time_s", "x_m", "y_m")
OPTIONAL = ("heading_rad", "speed_mps", "length_m", "width_m")


USUAL_SIZE_M = {"length_m": 5.0, "width_m": 2.0}
"""Size of a vehicle whose track has none."""

LARGEST_SIZE_M = {"length_m": 100.0, "width_m": 20.0}
"""Larger vehicles are in another unit. The longest road trains have 54 m."""

WIDEST_M = 3.0
"""What moves on a road and is wider has its length and width exchanged, if it is shorter."""

FARTHEST_M = 1e8
"""Coordinates beyond this are no places on Earth: northings reach 10⁷ m. [m]"""

FARTHEST_OF_ROAD_M = 1e5
"""Places of scenes are of single precision: beyond this they are rounded to more than 4 mm. [m]"""

LATEST = 1e19
"""Times beyond this are none in any unit: there have been 1.8 · 10¹⁸ ns since 1970."""


STANDING_MPS = 0.1
"""Below this speed a direction does not follow from two positions. [m/s]"""

LONGEST_GAP_S = 1.0
"""A vehicle that is lost for longer may have done anything in between. [s]"""

SHORTEST_PERIOD_S = 0.005
"""Rows of recordings are further apart. [s]"""

FASTEST_MPS = 100.0
MOST_CUTS = 10
"""A vehicle with more cuts than this is no vehicle."""

NOISE_FACTOR = 6.0
LEAST_JUMP_M, LARGEST_NOISE_M = 3.0, 8.0
JUMP_MPS2 = 24.0
"""A vehicle jumps where it is farther from its straight course than what this acceleration, about
twice that of the hardest braking, and its usual noise times `NOISE_FACTOR` explain. [m/s²]"""

MOST_STEPS = 10_000
"""Longest episode, as of bridges."""

MOST_VEHICLES = 999
"""Channels name vehicles up to this number."""

MOST_XML_BYTES = 500_000_000

WINDOW_S = 1.0
MOVING_MPS = 2.0
"""Motion is averaged over this time, and compared with headings from this speed on."""

NOISES_OF_WAY = 12.0
"""A way of so many standard deviations of the positions has a direction within 0.5 rad."""

MOST_NOISES = 3.0

LEAST_NOISE_M = 0.004
"""Less noise than this, such as positions rounded to 1 cm, does not turn a vehicle that stands."""

ROWS_OF_NOISE = 8
"""Fewer rows say nothing of noise."""

USUAL_JERK_MPS3 = 5.0
"""Differences of positions that this explains are motion, and no noise. [m/s³]"""

NOISES_OF_STANDING = 10.0
"""A vehicle that stands stays within so many standard deviations of its positions."""

COARSEST_STEP_M = 0.1
NOISES_OF_STEP = 0.3
"""Positions that are rounded to a step have noise of this share of it, as even errors have."""

CREEPING_MPS = 0.5
"""From this speed on noisy positions have a direction, if their way has. [m/s]"""

REVERSING_MPS = 5.0
"""Up to this speed a vehicle may drive backwards. [m/s]"""

REVERSING_M, REVERSING_SHARE = 15.0, 0.5
"""It does so for this way and share of its time at most, where no negative speeds say so."""

MOST_TURN_RAD = 0.5
CONTRADICTING_SHARE = 0.05
"""A track contradicts itself where its heading differs by more from the direction of its motion, at
more than this share of its times."""

MOST_SLIP_RAD = 0.15
"""Vehicles that go straight slip by less: their headings are this near to their motion."""

DEGREES = 180.0 / pi
FEWEST_BLOCKS, SLOPE_ERRORS = 8.0, 5.0
"""Stretches of time with changes of direction, and standard errors of the slope of the heading over
the direction, from which the unit of headings is certain."""

MOST_RATIO, MOST_DIFFERENCE_MPS = 1.5, 1.0
"""The same for its speeds: their mean against that of its motion."""

OTHER_UNITS_OF_TIME = {"milliseconds": 1e3, "microseconds": 1e6, "nanoseconds": 1e9}
OTHER_UNITS_OF_SPEED = {"km/h": 3.6, "miles per hour": 2.23694, "feet per second": 3.28084}
OTHER_HEADINGS: Mapping[str, Callable[[Doubles], Doubles]] = {
    "in degrees": np.radians,
    "compass directions in degrees": lambda heading: 0.5 * pi - np.radians(heading),
    "compass directions": lambda heading: 0.5 * pi - heading,
    "clockwise": lambda heading: -heading,
    "clockwise, in degrees": lambda heading: -np.radians(heading),
    "those of the rear, reversed": lambda heading: heading + pi,
}
"""What headings may be that contradict the motion."""

HEADING_REMEDY = (
    "Give radians, anticlockwise from x, of the front of the vehicle. Without the column, headings "
    "follow from the positions."
)

MOST_HEADING_RAD = 100.0
"""No vehicle turns so often; sentinels such as -999 lie beyond it."""

VERSIONS = ("2018b", "2020a")
"""Versions of CommonRoad that are read."""

MOST_NAMED = 20
"""Names that an error or a note lists."""


REMEDY = f"A track has the columns {', '.join(REQUIRED)}, and perhaps {', '.join(OPTIONAL)}."
COLUMNS = TableColumns("id", REQUIRED[1:], OPTIONAL, REMEDY)

Track = Mapping[str, Doubles]
"""Columns of a vehicle in order of time, each of shape (rows,)."""


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
    y is to the left. Headings and speeds that are missing follow from the positions. Of CommonRoad
    XML (2018b or 2020a) the obstacles with exact states and a rectangle are read; static ones stand
    all the time.

    A vehicle that is lost for longer than `longest_gap_s` while it moves, or that jumps, ends
    there: what comes after is another vehicle, named `ID, part 2`.

    Args:
        path: CSV; Parquet if its name ends in `.parquet`, CommonRoad if it ends in `.xml`.
        ego: id of the vehicle that a planner is to replace.
        dt_s: time between two steps.
        frame: where the road is in the file, if not along its x axis.
        longest_gap_s: longest time between two rows of a vehicle that is interpolated.
        without: ids of vehicles to leave out on purpose.

    Raises:
        UnknownName: the file has no vehicle of a name in `without`.
        InvalidValue: the file cannot be read, lacks a column or a number, or contradicts itself; it
            has no such ego, or none that can be used, or more steps than an episode can have; or
            there is a time at which no other vehicle is there.
    """
    path = Path(path)
    _refuse_arguments(dt_s, longest_gap_s, without)
    ego = str(ego)
    read = _read_commonroad if path.suffix.lower() == ".xml" else _read_table_of_tracks
    found = read(path)
    unwanted = set(map(str, without))
    for name in unwanted:
        if name not in found.tracks and name not in found.left_out:
            raise UnknownName("without", name, (*found.tracks, *found.left_out))
    kept = {name: track for name, track in found.tracks.items() if name not in unwanted}
    left_out = {name: why for name, why in found.left_out.items() if name not in unwanted}
    _refuse_units_of_time(kept, longest_gap_s)
    parts, cuts, single = _cut_tracks(kept, longest_gap_s, left_out)
    notes = [
        f"'{name}' {why}. Its parts are vehicles of their own: "
        f"{_list_names(_find_parts(parts, name))}."
        for name, why in cuts.items()
    ]
    notes += single
    track = _find_ego(path, ego, parts, cuts, _File(kept, left_out, (*found.notes, *notes)))
    for name, part in [*parts.items()]:
        notes += _check_headings(name, part, is_ego=name == ego)
        parts[name], flipped = _flip_speeds(name, part)
        notes += flipped
        _refuse_other_speeds(name, part)
    notes += _check_unit_of_headings(parts)
    grid_s = _make_grid(ego, track, dt_s)
    spans = {name: _find_span(part, grid_s) for name, part in parts.items()}
    ids, never = _choose_vehicles(path, ego, spans)
    if never:
        notes.append(f"Not there for a step of the time of '{ego}' at least: {_list_names(never)}.")
    states = np.full((len(grid_s), len(ids), 4), np.nan)
    for number, name in enumerate(ids):
        first, last = spans[name]
        own_s = grid_s[first : last + 1]
        course = _interpolate(parts[name], own_s)
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
    """Refuse durations that are none, and a text as a list of ids: it would be one of letters.

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


class _File(NamedTuple):
    """Vehicles of a file.

    Attributes:
        tracks: the columns of each vehicle, by name.
        left_out: vehicles in a form that is not read, with the reason.
        notes: what else of the file is not read, in sentences.
    """

    tracks: Mapping[str, Track]
    left_out: Mapping[str, str]
    notes: tuple[str, ...] = ()


def _list_names(names: Iterable[str]) -> str:
    listed = list(names)
    more = f" and {len(listed) - MOST_NAMED} more" if len(listed) > MOST_NAMED else ""
    return ", ".join(listed[:MOST_NAMED]) + more


def _read_table_of_tracks(path: Path) -> _File:
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
        _refuse_impossible(name, tracks[name])
    notes = [f"Columns that are not read: {_list_names(table.unread)}."] if table.unread else []
    for column, names in lacking.items():
        source = "is that of other rows" if column in USUAL_SIZE_M else "follows from positions"
        notes.append(f"{column} of {_list_names(names)} {source}: some rows lack it.")
    return _File(tracks, {}, tuple(notes))


def _make_track(
    columns: Mapping[str, Doubles], order: NDArray[np.int64]
) -> tuple[Track, list[str]]:
    """Return the columns of a vehicle, those of OPTIONAL if it has them, and which of them lacked.

    A size that some rows lack is that of the others; of headings and speeds none is kept.
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


def _refuse_impossible(name: str, track: Track) -> None:
    """Refuse a vehicle with two rows of one time, and places or sizes that no vehicle has.

    Args:
        name: name of the vehicle.
        track: its columns, in order of time.

    Raises:
        InvalidValue: it has.
    """
    if (latest := float(np.abs(track["time_s"]).max())) > LATEST:
        problem = f"time_s of vehicle '{name}' reaches {latest:g}."
        raise InvalidValue("tracks", problem, "Give it in seconds.")
    if (np.diff(track["time_s"]) <= 0.0).any():
        place = int(np.argmax(np.diff(track["time_s"]) <= 0.0))
        problem = f"Vehicle '{name}' has two rows of one time, {track['time_s'][place]:g} s."
        remedy = "Remove one of them, or give each vehicle an id of its own."
        raise InvalidValue("tracks", problem, remedy)
    for column in ("x_m", "y_m"):
        if (far := np.abs(track[column]) > FARTHEST_M).any():
            value = track[column][int(np.argmax(far))]
            problem = f"{column} of vehicle '{name}' is {value:g}, which is not a place on Earth."
            raise InvalidValue("tracks", problem, "Give positions in metres.")
    _refuse_sizes(name, track)


def _refuse_sizes(name: str, track: Track) -> None:
    """Refuse sizes that no vehicle has.

    Raises:
        InvalidValue: the vehicle has one.
    """
    for column, largest_m in LARGEST_SIZE_M.items():
        for value in track.get(column, ()):
            if not 0.0 < value <= largest_m:
                problem = (
                    f"{column} of vehicle '{name}' is {value:g}. It must be above 0 and at most "
                    f"{largest_m:g} m."
                )
                remedy = "Correct it, or remove the column if the size is not known."
                raise InvalidValue("tracks", problem, remedy)
    length_m, width_m = (float(np.max(track.get(each, [0.0]))) for each in LARGEST_SIZE_M)
    moved_m = float(np.hypot(np.ptp(track["x_m"]), np.ptp(track["y_m"])))
    if width_m > max(length_m, WIDEST_M) and length_m and moved_m > length_m:
        problem = f"Vehicle '{name}' is {width_m:g} m wide, {length_m:g} m long, and moves."
        remedy = "Exchange length_m and width_m, or correct them."
        raise InvalidValue("tracks", problem, remedy)


def _refuse_units_of_time(tracks: Mapping[str, Track], longest_gap_s: float) -> None:
    """Refuse a recording whose rows are mostly further apart than the longest gap.

    Raises:
        InvalidValue: they are; if they are as in another unit of time, with its name.
    """
    apart = [np.diff(track["time_s"]) for track in tracks.values() if not _stands(track)]
    pooled = np.concatenate([np.zeros(0), *apart])
    usual_s = float(np.median(pooled)) if len(pooled) else 0.0
    if usual_s <= longest_gap_s:
        return
    units = [
        name
        for name, count in OTHER_UNITS_OF_TIME.items()
        if SHORTEST_PERIOD_S <= usual_s / count <= LONGEST_GAP_S
    ]
    problem = f"the rows of a vehicle are {usual_s:g} s apart."
    remedy = f"Record more often, or set `longest_gap_s` above {usual_s:g}."
    if units:
        problem = f"the rows of a vehicle are {usual_s:g} apart, so it seems to be in {units[0]}."
        remedy = "Give it in seconds."
    raise InvalidValue("time_s", problem, remedy)


def _stands(track: Track) -> bool:
    return bool(np.ptp(track["x_m"]) == np.ptp(track["y_m"]) == 0.0)


def _cut_tracks(
    tracks: Mapping[str, Track], longest_gap_s: float, left_out: dict[str, str]
) -> tuple[dict[str, Track], dict[str, str], list[str]]:
    """Return the parts of vehicles between gaps and jumps by name, and the cuts in words.

    The last value names the rows that are no part, since no motion follows from one. Vehicles that
    have no other rows are added to those left out.
    """
    parts: dict[str, Track] = {}
    cuts: dict[str, str] = {}
    notes: list[str] = []
    for name, track in tracks.items():
        ends, why = _find_cuts(track, longest_gap_s)
        if len(track["time_s"]) == 1:
            left_out[name] = "It is there at a single time, from which no motion follows."
        elif not len(ends):
            parts[name] = track
        elif len(ends) > MOST_CUTS:
            left_out[name] = f"It {why}. Its id may be that of several vehicles."
        else:
            bounds = [0, *(ends + 1).tolist(), len(track["time_s"])]
            spans = [(first, last) for first, last in pairwise(bounds) if last - first > 1]
            for number, (first, last) in enumerate(spans, 1):
                part = {column: values[first:last] for column, values in track.items()}
                parts[f"{name}, part {number}"] = part
            if not spans:
                left_out[name] = f"It {why}. No motion follows from single rows."
                continue
            cuts[name] = why
            single = [first for first, last in pairwise(bounds) if last - first == 1]
            if single:
                times = _list_names(f"{at_s:g} s" for at_s in track["time_s"][single])
                rows = "1 row" if len(single) == 1 else f"{len(single)} rows"
                verb = "is" if len(single) == 1 else "are"
                notes.append(f"{rows} of '{name}' at {times} {verb} left out.")
    return parts, cuts, notes


def _find_cuts(track: Track, longest_gap_s: float) -> tuple[NDArray[np.int64], str]:
    """Return the rows after which a vehicle is lost or jumps, and that in words."""
    time_s = track["time_s"]
    place = np.stack([track["x_m"], track["y_m"]], axis=1)
    apart_s, way = np.diff(time_s), np.diff(place, axis=0)
    way_m = np.hypot(way[:, 0], way[:, 1])
    moves = way_m > np.maximum(STANDING_MPS * apart_s, STANDING_MPS)
    is_gap = (apart_s > longest_gap_s + 1e-6) & moves
    speed = way / apart_s[:, None]
    is_jump = (way_m > FASTEST_MPS * apart_s) & (way_m > LEAST_JUMP_M)
    if len(way) > 1:
        # Both neighbours of a step must disagree with it, so that one braking hard is no jump.
        change = np.hypot(*np.diff(speed, axis=0).T)
        off_before_m, off_after_m = change * apart_s[1:], change * apart_s[:-1]
        usual_m = NOISE_FACTOR * float(np.median(off_before_m))
        least_m = min(max(LEAST_JUMP_M, usual_m), LARGEST_NOISE_M)
        allowed_m = least_m + 0.5 * JUMP_MPS2 * apart_s**2
        off_before = np.concatenate([[True], off_before_m > allowed_m[1:]])
        off_after = np.concatenate([off_after_m > allowed_m[:-1], [True]])
        is_jump |= off_before & off_after
    is_jump &= ~is_gap
    ends = np.flatnonzero(is_gap | is_jump)
    words = [
        f"{'is lost' if is_gap[end] else 'jumps by ' + format(way_m[end], '.3g') + ' m'} "
        f"from {time_s[end]:g} s to {time_s[end + 1]:g} s"
        for end in ends[:MOST_NAMED].tolist()
    ]
    more = f", and {len(ends) - MOST_NAMED} times more" if len(ends) > MOST_NAMED else ""
    return ends, ", ".join(words) + more


def _find_ego(
    path: Path, ego: str, parts: Mapping[str, Track], cuts: Mapping[str, str], found: _File
) -> Track:
    """Return the track of the ego.

    Raises:
        InvalidValue: there is no such vehicle that can be used.
    """
    if ego in parts:
        return parts[ego]
    if ego in found.left_out:
        problem = f"'{ego}' cannot be used. {found.left_out[ego]}"
        raise InvalidValue("ego", problem, "Choose another vehicle.")
    if ego in cuts:
        remedy = f"Choose a part of it: {_list_names(_find_parts(parts, ego))}."
        raise InvalidValue("ego", f"'{ego}' {cuts[ego]}.", remedy)
    said = " ".join(found.notes)
    if not parts:
        reasons = " ".join(_explain_left_out(found.left_out))
        problem = f"{path.name} has no vehicle that can be used. {reasons} {said}".strip()
        raise InvalidValue("tracks", problem, REMEDY)
    known = _list_names(sorted(parts))
    raise InvalidValue("ego", f"'{ego}' is not in {path.name}.", f"It has {known}. {said}".strip())


def _find_parts(parts: Mapping[str, Track], name: str) -> list[str]:
    return [
        f"'{part}' ({track['time_s'][0]:g} s to {track['time_s'][-1]:g} s)"
        for part, track in parts.items()
        if part.startswith(f"{name}, part ")
    ]


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
    """Refuse a recording in which the ego is alone for a while.

    Raises:
        InvalidValue: it is.
    """
    alone = ~np.isfinite(states[:, 1:, 0]).any(axis=1)
    if not alone.any():
        return
    at_s, said = grid_s[int(np.argmax(alone))], " ".join(reasons)
    problem = f"No other vehicle of {path.name} is there beside '{ego}' at {at_s:g} s. {said}"
    raise InvalidValue("tracks", problem.strip(), "Cut the recording to a shorter time.")


class _Motion(NamedTuple):
    """Motion of a vehicle at each row, over `WINDOW_S`.

    Attributes:
        direction: direction of its motion, shape (rows,). [rad]
        speed: its size, shape (rows,). [m/s]
        moves: whether it is fast enough to have a direction, shape (rows,).
        noise_m: standard deviation of its positions, by their second differences. [m]
    """

    direction: Doubles
    speed: Doubles
    moves: NDArray[np.bool_]
    noise_m: float


def _find_motion(track: Track) -> _Motion:
    place = np.stack([track["x_m"], track["y_m"]], axis=1)
    # Of noise of a standard deviation s in both directions, half of the second differences are
    # larger than 2.88 s.
    bends = np.hypot(*np.diff(place, 2, axis=0).T)
    noise_m = float(np.median(bends)) / 2.88 if len(bends) else 0.0
    along_m, across_m, lasts_s = _find_way(track, track["time_s"])
    way_m = np.hypot(along_m, across_m)
    speed = way_m / lasts_s
    return _Motion(
        direction=np.arctan2(across_m, along_m),
        speed=speed,
        moves=(speed >= MOVING_MPS) & (way_m >= NOISES_OF_WAY * noise_m),
        noise_m=noise_m,
    )


def _find_way(track: Track, at_s: Doubles) -> tuple[Doubles, Doubles, Doubles]:
    """Return the ways along x and y within `WINDOW_S` around some times, and how long they took."""
    time_s = track["time_s"]
    before_s = np.clip(at_s - 0.5 * WINDOW_S, time_s[0], time_s[-1])
    after_s = np.clip(at_s + 0.5 * WINDOW_S, time_s[0], time_s[-1])
    along_m, across_m = (
        np.interp(after_s, time_s, track[name]) - np.interp(before_s, time_s, track[name])
        for name in ("x_m", "y_m")
    )
    return along_m, across_m, after_s - before_s


class _Noise(NamedTuple):
    """Noise of the positions of a vehicle.

    Attributes:
        noise_m: its standard deviation in each direction.
        explained_m: what of it may be motion.
    """

    noise_m: float
    explained_m: float


def _find_noise(track: Track) -> _Noise:
    """Return the noise of positions, by what differs from constant acceleration over four rows."""
    time_s = track["time_s"]
    if len(time_s) < ROWS_OF_NOISE:
        return _Noise(0.0, 0.0)
    times = np.lib.stride_tricks.sliding_window_view(time_s, 4)
    apart = times[:, :, None] - times[:, None, :] + np.eye(4)
    # Third divided differences, which are a sixth of the jerk.
    weights = 1.0 / apart.prod(axis=2)
    size = np.sqrt((weights**2).sum(axis=1))
    along, across = (
        (weights * np.lib.stride_tricks.sliding_window_view(track[name] - track[name][0], 4)).sum(1)
        for name in ("x_m", "y_m")
    )
    # Half of the lengths of pairs of normal numbers are larger than 1.177.
    noise_m = float(np.median(np.hypot(along, across) / size)) / 1.177
    return _Noise(
        max(noise_m, NOISES_OF_STEP * _find_step(track)),
        USUAL_JERK_MPS3 / 6.0 / float(np.median(size)),
    )


def _find_step(track: Track) -> float:
    """Return the step that the positions of a vehicle are rounded to; 0 if they are not. [m]"""
    ways_m = np.concatenate([np.diff(track[name]) for name in ("x_m", "y_m")])
    bends_m = np.concatenate([np.diff(track[name], 2) for name in ("x_m", "y_m")])
    sizes_m = np.abs(ways_m)
    least_m = float(np.min(sizes_m[sizes_m > 1e-6], initial=np.inf))
    if least_m > COARSEST_STEP_M + 1e-6 or not (np.abs(bends_m) > 1e-6).any():
        return 0.0
    is_rounded = np.abs(ways_m - least_m * np.round(ways_m / least_m)) < 1e-3 * least_m
    return least_m if is_rounded.all() else 0.0


def _find_turn(heading: Doubles, direction: Doubles) -> Doubles:
    return np.abs((heading - direction + pi) % (2.0 * pi) - pi)


def _find_reversing(track: Track, motion: _Motion, heading: Doubles) -> NDArray[np.bool_]:
    """Return where a vehicle drives backwards, if it has these headings.

    All headings may be those of the rear. They are not if negative speeds agree with them, or if
    the vehicle reverses for a short way and a part of its time.
    """
    backwards = _find_turn(heading, motion.direction) > pi - MOST_TURN_RAD
    reverses = motion.moves & backwards & (motion.speed < REVERSING_MPS)
    if "speed_mps" in track:
        is_told = reverses & (track["speed_mps"] < -STANDING_MPS)
        if is_told.sum() >= (1.0 - CONTRADICTING_SHARE) * reverses.sum():
            return reverses
    lasts_s = np.gradient(track["time_s"])
    way_m = float((lasts_s * motion.speed)[reverses].sum())
    share = float(lasts_s[reverses].sum() / lasts_s.sum())
    is_short = way_m <= REVERSING_M and share <= REVERSING_SHARE
    return reverses & is_short


def _check_headings(name: str, track: Track, *, is_ego: bool) -> list[str]:
    """Return a note if a vehicle reverses, and one if few headings contradict its motion.

    Args:
        name: name of the vehicle.
        track: its columns.
        is_ego: whether a planner replaces it: it does not reverse, since its way leads ahead.

    Raises:
        InvalidValue: more do. If they agree as something else, the error names it.
    """
    if "heading_rad" not in track:
        return []
    motion = _find_motion(track)
    direction, moves = motion.direction, motion.moves

    def find_turn(heading: Doubles) -> Doubles:
        return _find_turn(heading, direction)

    def find_wrong(heading: Doubles) -> NDArray[np.bool_]:
        wrong = moves & (find_turn(heading) > MOST_TURN_RAD)
        return wrong if is_ego else wrong & ~_find_reversing(track, motion, heading)

    heading = track["heading_rad"]
    # Headings may go on growing in turns; what nothing can be held against must be within one.
    most = MOST_HEADING_RAD if moves.any() else 2.0 * pi + 1e-6
    is_outside = np.abs(heading) > most
    wrong = find_wrong(heading) | is_outside
    notes = [] if is_ego else _note_reversing(name, track, motion)
    if not wrong.any():
        return notes
    if wrong.sum() <= CONTRADICTING_SHARE * moves.sum() and not is_outside.any():
        times = int(wrong.sum())
        return [*notes, f"The heading of '{name}' contradicts its motion at {times} times."]
    row = int(np.argmax(wrong))
    other = {
        words: float(find_turn(change(heading))[moves].mean())
        for words, change in OTHER_HEADINGS.items()
        if moves.any() and find_wrong(change(heading)).sum() <= CONTRADICTING_SHARE * moves.sum()
    }
    seems = f" The headings seem to be {min(other, key=other.__getitem__)}." if other else ""
    moves_so = f"it moves in the direction {direction[row]:.3g} rad" if moves.any() else "it stands"
    problem = (
        f"of vehicle '{name}' is {heading[row]:g} at {track['time_s'][row]:g} s, and "
        f"{moves_so}.{seems}"
    )
    raise InvalidValue("heading_rad", problem, HEADING_REMEDY)


def _check_unit_of_headings(tracks: Mapping[str, Track]) -> list[str]:
    """Return a note on vehicles whose headings lie beside their motion.

    Headings in degrees pass for radians where the road lies within half a degree of x.

    Raises:
        InvalidValue: most vehicles that move have such headings, or their headings change as those
            in degrees do.
    """
    products, squares, beside = [], [], {}
    moving = 0
    for name, track in tracks.items():
        if "heading_rad" not in track:
            continue
        motion = _find_motion(track)
        heading, direction = _average_heading(track), np.unwrap(motion.direction)
        turn = (heading - direction + pi) % (2.0 * pi) - pi
        # A heading that contradicts motion by more is noted or refused for each vehicle.
        counted = motion.moves & (np.abs(turn) <= MOST_TURN_RAD)
        if counted.sum() < ROWS_OF_NOISE:
            continue
        moving += 1
        apart_rad = float(np.median(np.abs(turn[counted])))
        in_degrees = float(np.median(_find_turn(np.radians(heading), direction)[counted]))
        if apart_rad > MOST_SLIP_RAD and in_degrees < apart_rad / DEGREES**0.5:
            beside[name] = apart_rad
        change = direction[counted] - direction[counted].mean()
        # Ways of one window overlap, so only blocks of the time are independent.
        block = (track["time_s"][counted] // (2.0 * WINDOW_S)).astype(np.int64)
        _, block = np.unique(block, return_inverse=True)
        turned = change + turn[counted] - turn[counted].mean()
        products += np.bincount(block, change * turned).tolist()
        squares += np.bincount(block, change**2).tolist()
    names = _list_names(f"'{name}'" for name in beside)
    if _is_in_degrees(np.array(products), np.array(squares)):
        problem = (
            "changes by about 57 times as much as the direction of the motion. The headings seem "
            "to be in degrees."
        )
        raise InvalidValue("heading_rad", problem, HEADING_REMEDY)
    if not beside:
        return []
    largest = max(beside.values())
    problem = (
        f"of {names} differs from the direction of the motion by up to {largest:.2g} rad "
        f"({np.degrees(largest):.0f}°) in the median"
    )
    if len(beside) > 0.5 * moving:
        seems = "The headings seem to be in degrees, or from another axis than x."
        raise InvalidValue("heading_rad", f"{problem}. {seems}", HEADING_REMEDY)
    return [f"The heading {problem}: check its unit, which is rad, and its axis."]


def _average_heading(track: Track) -> Doubles:
    """Return the mean heading over `WINDOW_S` around each row, as motion is averaged."""
    time_s, heading = track["time_s"], np.unwrap(track["heading_rad"])
    turns = np.cumsum(0.5 * (heading[1:] + heading[:-1]) * np.diff(time_s))
    sums = {"time_s": time_s, "x_m": np.concatenate([[0.0], turns]), "y_m": np.zeros(len(time_s))}
    total, _, lasts_s = _find_way(sums, time_s)
    return np.asarray(total / lasts_s, np.float64)


def _is_in_degrees(products: Doubles, squares: Doubles) -> bool:
    """Return whether changes of headings are those of directions in degrees, by blocks of time.

    Args:
        products: sum of the changes of direction times those of heading, shape (blocks,).
        squares: sum of the squared changes of direction, shape (blocks,).
    """
    total = squares.sum()
    if not total > 0.0 or total**2 < FEWEST_BLOCKS * np.square(squares).sum():
        return False
    slope = products.sum() / total
    error = float(np.sqrt(np.square(products - slope * squares).sum())) / total
    return bool(slope - SLOPE_ERRORS * error > DEGREES**0.5)


def _note_reversing(name: str, track: Track, motion: _Motion) -> list[str]:
    reverses = _find_reversing(track, motion, track["heading_rad"])
    if not reverses.any():
        return []
    first_s, last_s = track["time_s"][np.flatnonzero(reverses)[[0, -1]]]
    when = f"between {first_s:g} s and {last_s:g} s"
    return [f"'{name}' is taken as reversing {when}: its heading is against its motion."]


def _flip_speeds(name: str, track: Track) -> tuple[Track, list[str]]:
    """Return a vehicle with negative speeds where it reverses and they have no sign; and a note."""
    if "heading_rad" not in track or "speed_mps" not in track:
        return track, []
    heading, told = track["heading_rad"], track["speed_mps"]
    reverses = _find_reversing(track, _find_motion(track), heading)
    if not (reverses & (told > STANDING_MPS)).any():
        return track, []
    along_m, across_m, _ = _find_way(track, track["time_s"])
    backwards = np.cos(heading) * along_m + np.sin(heading) * across_m < 0.0
    # The slow begin and end of reversing belong to it.
    bounds = np.flatnonzero(np.diff(backwards, prepend=False, append=False)).tolist()
    wrong = np.zeros_like(reverses)
    for first, last in zip(bounds[::2], bounds[1::2], strict=True):
        wrong[first:last] = reverses[first:last].any()
    wrong &= told > 0.0
    note = f"Speeds of '{name}' are taken as negative at {int(wrong.sum())} times: it reverses."
    return {**track, "speed_mps": np.where(wrong, -told, told)}, [note]


def _refuse_other_speeds(name: str, track: Track) -> None:
    """Refuse a vehicle whose speeds are not those of its motion.

    Raises:
        InvalidValue: they are not. If they are as in another unit, the error names it.
    """
    if "speed_mps" not in track:
        return
    # Without headings, the vehicle points where it goes.
    direction, moved_mps, moves, noise_m = _find_motion(track)
    forwards = moves & (np.cos(track.get("heading_rad", direction) - direction) > 0.0)
    negative = forwards & (track["speed_mps"] < -STANDING_MPS)
    if negative.sum() > CONTRADICTING_SHARE * moves.sum():
        at_s = track["time_s"][int(np.argmax(negative))]
        problem = f"of vehicle '{name}' is negative at {at_s:g} s, and the vehicle moves forwards."
        raise InvalidValue("speed_mps", problem, "Give the speed along the vehicle's heading.")
    told, moved = float(np.abs(track["speed_mps"]).mean()), float(moved_mps.mean())
    differs = abs(told - moved) > MOST_DIFFERENCE_MPS + MOST_NOISES * noise_m / WINDOW_S
    if not differs or moved / MOST_RATIO <= told <= moved * MOST_RATIO:
        return
    units = [
        unit
        for unit, count in OTHER_UNITS_OF_SPEED.items()
        if abs(told / count - moved) < 0.1 * moved
    ]
    seems = f" The speeds seem to be in {units[0]}." if units else ""
    problem = (
        f"of vehicle '{name}' is {told:.3g} on average, and it moves at {moved:.3g} m/s by its "
        f"positions.{seems}"
    )
    remedy = "Give metres, seconds and metres per second, or leave the column out."
    raise InvalidValue("speed_mps", problem, remedy)


def _read_commonroad(path: Path) -> _File:
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
        _refuse_impossible(name, track)
    notes = [*_list_unread(root, obstacles)]
    for column in ("heading_rad", "speed_mps"):
        lacking = [
            name
            for name, own in states.items()
            if column not in tracks[name] and any(column in state for state in own)
        ]
        if lacking:
            notes.append(
                f"{column} of {_list_names(lacking)} follows from positions: some states lack it."
            )
    return _File(tracks, left_out, tuple(notes))


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
    """Yield what is not read of a CommonRoad file, in sentences."""
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


def _rotate_states(states: Doubles, frame: RoadFrame) -> Doubles:
    """Return states in a frame in which the road is along x."""
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


def _interpolate(track: Track, grid_s: Doubles) -> Doubles:
    """Return x, y, heading and speed at the times of a grid, shape (times, 4).

    Headings of a vehicle that never moves are NaN if they are not known.
    """
    time_s = track["time_s"]
    x_m, y_m = (np.interp(grid_s, time_s, track[name]) for name in ("x_m", "y_m"))
    given = None
    if "heading_rad" in track:
        given = np.interp(grid_s, time_s, np.unwrap(track["heading_rad"]))
    heading, speed = _derive_motion(track, grid_s, (x_m, y_m), given)
    if "speed_mps" in track:
        speed = np.interp(grid_s, time_s, track["speed_mps"])
    return np.stack([x_m, y_m, heading, speed], axis=1)


def _derive_motion(
    track: Track, grid_s: Doubles, place_m: tuple[Doubles, Doubles], given: Doubles | None
) -> tuple[Doubles, Doubles]:
    """Return headings and speeds at the times of a grid, by the positions.

    Where these are noisy, motion is that over `WINDOW_S`, since that between two steps would be
    noise: a vehicle that stands would spin.

    Args:
        track: columns of the vehicle.
        grid_s: the times.
        place_m: x and y at these times.
        given: its headings at these times, if they are known: motion against them is negative.
    """
    noise_m, explained_m = _find_noise(track)
    told_mps = np.abs(track["speed_mps"]) if "speed_mps" in track else None
    extent_m = float(np.hypot(np.ptp(track["x_m"]), np.ptp(track["y_m"])))
    is_still = noise_m > 0.0 and extent_m <= NOISES_OF_STANDING * noise_m
    if is_still or (told_mps is not None and told_mps.max() <= STANDING_MPS):
        return np.full_like(grid_s, np.nan) if given is None else given, np.zeros_like(grid_s)
    if noise_m <= max(LEAST_NOISE_M, explained_m):
        along, across = (np.gradient(each, grid_s) for each in place_m)
        moved_mps = np.hypot(along, across)
        if given is not None:
            is_ahead = np.cos(given) * along + np.sin(given) * across >= 0.0
            return given, np.where(is_ahead, moved_mps, -moved_mps)
        moves = moved_mps > STANDING_MPS
        return _hold_direction(np.arctan2(across, along), moves), moved_mps
    # A whole window, also at the ends: half of it has the same noise over half of the way.
    first_s, last_s = track["time_s"][[0, -1]] + [0.5 * WINDOW_S, -0.5 * WINDOW_S]
    around_s = np.clip(grid_s, first_s, max(first_s, last_s))
    along_m, across_m, lasts_s = _find_way(track, around_s)
    way_m = np.hypot(along_m, across_m)
    moves = (way_m >= CREEPING_MPS * lasts_s) & (way_m >= NOISES_OF_WAY * noise_m)
    if told_mps is not None:
        moves &= np.interp(grid_s, track["time_s"], told_mps) > STANDING_MPS
    heading = _hold_direction(np.arctan2(across_m, along_m), moves) if given is None else given
    ahead_m = np.cos(heading) * along_m + np.sin(heading) * across_m
    size_m = ahead_m if given is None else np.abs(ahead_m)
    is_motion = size_m > np.maximum(STANDING_MPS * lasts_s, MOST_NOISES * 2**0.5 * noise_m)
    return heading, np.where(is_motion, ahead_m / lasts_s, 0.0)


def _hold_direction(heading: Doubles, moves: np.ndarray[Any, Any]) -> Doubles:
    """Return the headings, with that of the nearest time of motion while a vehicle stands."""
    moving = np.flatnonzero(moves)
    if not len(moving):
        return np.full_like(heading, np.nan)
    steps = np.arange(len(heading))
    after = np.searchsorted(moving, steps).clip(max=len(moving) - 1)
    before = np.maximum(after - 1, 0)
    is_before_nearer = steps - moving[before] <= moving[after] - steps
    # Turns are counted over the moving steps alone: a vehicle that stands has no direction.
    turned = np.unwrap(heading[moving])
    return np.asarray(turned[np.where(is_before_nearer, before, after)], np.float64)


def _find_size(track: Track) -> tuple[float, float]:
    length_m, width_m = (
        float(np.median(track[name])) if name in track else usual
        for name, usual in USUAL_SIZE_M.items()
    )
    return length_m, width_m
