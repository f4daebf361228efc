"""Speeds held against the motion of their vehicle, so that another unit is found."""

import numpy as np

from eigenfail.errors import InvalidValue
from eigenfail_exchange.recorded_traffic.columns import STANDING_MPS, Track
from eigenfail_exchange.recorded_traffic.headings import CONTRADICTING_SHARE, find_reversing
from eigenfail_exchange.recorded_traffic.motion import MOST_NOISES, WINDOW_S, find_motion, find_way

MOST_RATIO, MOST_DIFFERENCE_MPS = 1.5, 1.0
"""Speeds contradict the motion if their mean differs by more than both from that of the motion."""


OTHER_UNITS_OF_SPEED = {"km/h": 3.6, "miles per hour": 2.23694, "feet per second": 3.28084}


def flip_speeds(name: str, track: Track) -> tuple[Track, list[str]]:
    """Return a vehicle with its positive speeds negated while it reverses; and a note."""
    if "heading_rad" not in track or "speed_mps" not in track:
        return track, []
    heading, told = track["heading_rad"], track["speed_mps"]
    reverses = find_reversing(track, find_motion(track), heading)
    if not (reverses & (told > STANDING_MPS)).any():
        return track, []
    along_m, across_m, _ = find_way(track, track["time_s"])
    backwards = np.cos(heading) * along_m + np.sin(heading) * across_m < 0.0
    # The slow begin and end of reversing belong to it.
    bounds = np.flatnonzero(np.diff(backwards, prepend=False, append=False)).tolist()
    wrong = np.zeros_like(reverses)
    for first, last in zip(bounds[::2], bounds[1::2], strict=True):
        wrong[first:last] = reverses[first:last].any()
    wrong &= told > 0.0
    note = f"Speeds of '{name}' are taken as negative at {int(wrong.sum())} times: it reverses."
    return {**track, "speed_mps": np.where(wrong, -told, told)}, [note]


def refuse_other_speeds(name: str, track: Track) -> None:
    """Refuse a vehicle whose speeds do not fit its motion.

    Raises:
        InvalidValue: they are not. If they are as in another unit, the error names it.
    """
    if "speed_mps" not in track:
        return
    # Without headings, the vehicle points where it goes.
    direction, moved_mps, moves, noise_m = find_motion(track)
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
