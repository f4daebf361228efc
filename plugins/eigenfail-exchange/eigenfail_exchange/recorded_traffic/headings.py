"""Headings held against the motion of their vehicle, so that another unit or axis is found."""

from collections.abc import Callable, Mapping
from math import pi

import numpy as np
from numpy.typing import NDArray

from eigenfail.errors import InvalidValue
from eigenfail.values.disturbance import Doubles
from eigenfail_exchange.recorded_traffic.columns import STANDING_MPS, Track, list_names
from eigenfail_exchange.recorded_traffic.motion import (
    ROWS_OF_NOISE,
    WINDOW_S,
    VehicleMotion,
    find_motion,
    find_way,
)

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


def _find_turn(heading: Doubles, direction: Doubles) -> Doubles:
    return np.abs((heading - direction + pi) % (2.0 * pi) - pi)


def find_reversing(track: Track, motion: VehicleMotion, heading: Doubles) -> NDArray[np.bool_]:
    """Return whether a vehicle with this heading drives backwards, at each row.

    All headings may point to the rear of the vehicle instead. They do not if negative speeds agree
    with them, or if the vehicle reverses for a short way and a part of its time.
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


def check_headings(name: str, track: Track, *, is_ego: bool) -> list[str]:
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
    motion = find_motion(track)
    direction, moves = motion.direction, motion.moves

    def find_turn(heading: Doubles) -> Doubles:
        return _find_turn(heading, direction)

    def find_wrong(heading: Doubles) -> NDArray[np.bool_]:
        wrong = moves & (find_turn(heading) > MOST_TURN_RAD)
        return wrong if is_ego else wrong & ~find_reversing(track, motion, heading)

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


def check_unit_of_headings(tracks: Mapping[str, Track]) -> list[str]:
    """Return a note on vehicles whose headings differ from their motion.

    If the road lies within half a degree of x, headings in degrees look like headings in radians.

    Raises:
        InvalidValue: most vehicles that move have such headings, or their headings change as those
            in degrees do.
    """
    products, squares, beside = [], [], {}
    moving = 0
    for name, track in tracks.items():
        if "heading_rad" not in track:
            continue
        motion = find_motion(track)
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
    names = list_names(f"'{name}'" for name in beside)
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
    total, _, lasts_s = find_way(sums, time_s)
    return np.asarray(total / lasts_s, np.float64)


def _is_in_degrees(products: Doubles, squares: Doubles) -> bool:
    """Return whether headings change as directions in degrees would, by blocks of time.

    Args:
        products: sum of direction changes times heading changes, shape (blocks,).
        squares: sum of the squared changes of direction, shape (blocks,).
    """
    total = squares.sum()
    if not total > 0.0 or total**2 < FEWEST_BLOCKS * np.square(squares).sum():
        return False
    slope = products.sum() / total
    error = float(np.sqrt(np.square(products - slope * squares).sum())) / total
    return bool(slope - SLOPE_ERRORS * error > DEGREES**0.5)


def _note_reversing(name: str, track: Track, motion: VehicleMotion) -> list[str]:
    reverses = find_reversing(track, motion, track["heading_rad"])
    if not reverses.any():
        return []
    first_s, last_s = track["time_s"][np.flatnonzero(reverses)[[0, -1]]]
    when = f"between {first_s:g} s and {last_s:g} s"
    return [f"'{name}' is taken as reversing {when}: its heading is against its motion."]
