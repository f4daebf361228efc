"""Tracks cut at losses and jumps of a vehicle, since its course in between is unknown."""

from collections.abc import Mapping
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from eigenfail.errors import InvalidValue
from eigenfail_exchange.recorded_traffic.columns import MOST_NAMED, STANDING_MPS, Track, list_names

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


OTHER_UNITS_OF_TIME = {"milliseconds": 1e3, "microseconds": 1e6, "nanoseconds": 1e9}


def refuse_units_of_time(tracks: Mapping[str, Track], longest_gap_s: float) -> None:
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


def cut_tracks(
    tracks: Mapping[str, Track], longest_gap_s: float, left_out: dict[str, str]
) -> tuple[dict[str, Track], dict[str, str], list[str]]:
    """Return the parts of vehicles between gaps and jumps by name, and the cuts in words.

    The last value names single rows that are left out, since no motion follows from one row.
    Vehicles without any part, or with more than `MOST_CUTS` cuts, are added to `left_out`.
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
                times = list_names(f"{at_s:g} s" for at_s in track["time_s"][single])
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


def find_parts(parts: Mapping[str, Track], name: str) -> list[str]:
    """Return the names of the parts of a vehicle, with the times at which each is there."""
    return [
        f"'{part}' ({track['time_s'][0]:g} s to {track['time_s'][-1]:g} s)"
        for part, track in parts.items()
        if part.startswith(f"{name}, part ")
    ]
