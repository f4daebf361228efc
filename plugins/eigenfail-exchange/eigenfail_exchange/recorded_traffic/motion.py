"""Motion of a vehicle by its positions, which may be noisy."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from eigenfail.values.disturbance import Doubles
from eigenfail_exchange.recorded_traffic.columns import STANDING_MPS, Track

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


class VehicleMotion(NamedTuple):
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


def find_motion(track: Track) -> VehicleMotion:
    """Return the motion of a vehicle at each of its rows."""
    place = np.stack([track["x_m"], track["y_m"]], axis=1)
    # Of noise of a standard deviation s in both directions, half of the second differences are
    # larger than 2.88 s.
    bends = np.hypot(*np.diff(place, 2, axis=0).T)
    noise_m = float(np.median(bends)) / 2.88 if len(bends) else 0.0
    along_m, across_m, lasts_s = find_way(track, track["time_s"])
    way_m = np.hypot(along_m, across_m)
    speed = way_m / lasts_s
    return VehicleMotion(
        direction=np.arctan2(across_m, along_m),
        speed=speed,
        moves=(speed >= MOVING_MPS) & (way_m >= NOISES_OF_WAY * noise_m),
        noise_m=noise_m,
    )


def find_way(track: Track, at_s: Doubles) -> tuple[Doubles, Doubles, Doubles]:
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


def interpolate(track: Track, grid_s: Doubles) -> Doubles:
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

    If the positions are noisy, motion is averaged over `WINDOW_S`. The motion between two steps
    would be noise, and a standing vehicle would spin.

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
    along_m, across_m, lasts_s = find_way(track, around_s)
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
    """Return the headings; during standstill, the heading at the nearest time of motion."""
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
