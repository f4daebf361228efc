"""Footprints in a stored scene: distances, times to collision, and the struck vehicle."""

from typing import Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray

from eigenfail.values.arrays import Floats
from eigenfail.values.scene import Scene

Array = NDArray[np.float64]

Side = Literal["front", "rear", "left side", "right side"]

SIDES: tuple[Side, ...] = get_args(Side)

CORNERS = 0.5 * np.array([(1.0, 1.0), (1.0, -1.0), (-1.0, -1.0), (-1.0, 1.0)])


LOOK_AHEAD_S = 1.0
"""As in the measures: who overlaps the ego laterally within this time enters its path. [s]"""

MOVED_S = 1e-4
"""Time over which the change of a distance is taken: its rate, but for rounding. [s]"""


class Contact(NamedTuple):
    """The vehicle that the ego hit.

    Attributes:
        struck: number of the vehicle that was struck.
        side: side of the ego at which the vehicle was.
    """

    struck: int
    side: Side


def measure_clearances(scene: Scene) -> Array:
    """Return the smallest distance from the ego's footprint to each vehicle's, at each moment.

    Two rectangles that do not overlap are nearest at a corner of one rectangle.

    Returns:
        Shape (steps + 1, vehicles - 1); 0 if footprints touch or overlap, and infinite while a
        vehicle is absent. [m]
    """
    return _measure_clearances(scene.vehicles.astype(np.float64), scene.sizes.astype(np.float64))


def _measure_clearances(vehicles: Array, sizes: Array) -> Array:
    ego, others = vehicles[:, :1, :3], vehicles[:, 1:, :3]
    one_apart, one_m = _measure_beside(ego, sizes[:1], others, sizes[1:])
    two_apart, two_m = _measure_beside(others, sizes[1:], ego, sizes[:1])
    apart_m = np.where(one_apart | two_apart, np.minimum(one_m, two_m), 0.0)
    return np.where(np.isnan(others[..., 0]), np.inf, apart_m)


def measure_times_to_collision(scene: Scene) -> Array:
    """Return the shortest time to collision of the ego with any vehicle, at each moment.

    The definition is the same as for the measure `min_ttc_s` (FHWA-RD-03-050, in the plane): the
    distance between the footprints ÷ the speed at which it shrinks. Only vehicles in the ego's path
    or entering it count.

    Returns:
        Shape (steps + 1,); infinite without a conflict. [s]
    """
    vehicles, sizes = scene.vehicles.astype(np.float64), scene.sizes.astype(np.float64)
    heading, speed = vehicles[..., 2], vehicles[..., 3]
    velocity = speed[..., None] * np.stack([np.cos(heading), np.sin(heading)], axis=-1)
    way = np.zeros_like(vehicles)
    way[..., :2] = 0.5 * MOVED_S * velocity
    apart_m = _measure_clearances(vehicles, sizes)
    # A central difference, whose error shrinks with the square of the time.
    before_m, after_m = (
        _measure_clearances(each, sizes) for each in (vehicles - way, vehicles + way)
    )
    there = np.isfinite(apart_m)
    # Distances of absent vehicles are infinite, and infinity less infinity is NaN.
    closing_m = np.subtract(before_m, after_m, out=np.zeros_like(apart_m), where=there)

    # Half of what a rectangle that is turned by its heading takes up across the road.
    half_m = 0.5 * (sizes[:, 0] * np.abs(np.sin(heading)) + sizes[:, 1] * np.abs(np.cos(heading)))
    offset_m = vehicles[:, 1:, 1] - vehicles[:, :1, 1]
    drift_mps = velocity[:, 1:, 1] - velocity[:, :1, 1]
    gap_m = np.abs(offset_m) - half_m[:, :1] - half_m[:, 1:]
    approach_mps = np.maximum(np.where(offset_m > 0.0, -drift_mps, drift_mps), 0.0)
    conflicts = there & (apart_m > 0.0) & (gap_m <= LOOK_AHEAD_S * approach_mps) & (closing_m > 0.0)
    times_s = np.full_like(apart_m, np.inf)
    np.divide(MOVED_S * apart_m, closing_m, out=times_s, where=conflicts)
    shortest_s: Array = times_s.min(axis=1, initial=np.inf)
    return shortest_s


def find_struck(scene: Scene) -> int:
    """Return the number of the vehicle whose footprint is nearest to the ego's at the end.

    Among vehicles at the same distance, the vehicle with the nearest centre is returned.
    """
    return _find_struck(scene.vehicles[-1].astype(np.float64), scene.sizes.astype(np.float64))


def _find_struck(vehicles: Array, sizes: Array) -> int:
    centres_m = np.linalg.norm(vehicles[1:, :2] - vehicles[0, :2], axis=1)
    clearances_m = _measure_clearances(vehicles[None], sizes)[0]
    return 1 + int(np.lexsort((centres_m, clearances_m))[0])


def find_contact(end: Floats, sizes: Floats) -> Contact | None:
    """Return the contact of the ego with the vehicle of `find_struck`.

    The side is the side of the ego on which the vehicle was farthest out before the last step. The
    overlap at the contact is only the movement within a step, which says little at a corner.

    Args:
        end: x [m], y [m], heading [rad] and speed [m/s] of all vehicles before and after the last
            step. Shape (2, vehicles, 4), or (1, vehicles, 4) without a step. Vehicle 0 is the ego.
            NaN while a vehicle is absent.
        sizes: length and width [m], shape (vehicles, 2).

    Returns:
        None if the ego is the only vehicle at the end.
    """
    vehicles, sizes_m = end.astype(np.float64), sizes.astype(np.float64)
    if not np.isfinite(vehicles[-1, 1:]).all(axis=1).any():
        return None
    struck = _find_struck(vehicles[-1], sizes_m)
    # A vehicle that appeared in the last step has no place before it.
    before = vehicles[0] if np.isfinite(vehicles[0, struck]).all() else vehicles[-1]
    # Corners of the struck vehicle, seen from the ego.
    corners = _transform(before[:1, :3], before[struck : struck + 1, :3], sizes_m[struck, None])[0]
    half_length_m, half_width_m = 0.5 * sizes_m[0]
    (rear_m, right_m), (front_m, left_m) = corners.min(axis=0), corners.max(axis=0)
    outside_m = (
        rear_m - half_length_m,
        -front_m - half_length_m,
        right_m - half_width_m,
        -left_m - half_width_m,
    )
    return Contact(struck, SIDES[int(np.argmax(outside_m))])


def _measure_beside(
    a: Array, size_a: Array, b: Array, size_b: Array
) -> tuple[NDArray[np.bool_], Array]:
    """Return whether a side of `a` separates both, and the distance from `a` to a corner of `b`.

    Args:
        a: x [m], y [m] and heading [rad], shape (..., vehicles, 3).
        size_a: length and width [m], shape (vehicles, 2).
        b: as `a`.
        size_b: as `size_a`.
    """
    corners = _transform(a, b, size_b)
    half = 0.5 * size_a[:, None, :]
    outside = (corners.min(axis=-2) > half[:, 0]) | (corners.max(axis=-2) < -half[:, 0])
    beyond = np.maximum(np.abs(corners) - half, 0.0)
    return outside.any(axis=-1), np.hypot(beyond[..., 0], beyond[..., 1]).min(axis=-1)


def _transform(a: Array, b: Array, size_b: Array) -> Array:
    """Return the corners of `b` in coordinates with origin at `a` and x along its heading.

    Args:
        a: x [m], y [m] and heading [rad], shape (..., vehicles, 3).
        b: as `a`.
        size_b: length and width [m], shape (vehicles, 2).

    Returns:
        x and y [m], shape (..., vehicles, corners, 2).
    """
    turned = CORNERS * size_b[:, None, :]
    in_road = _rotate(turned, b[..., 2]) + b[..., None, :2]
    return _rotate(in_road - a[..., None, :2], -a[..., 2])


def _rotate(points: Array, angle: Array) -> Array:
    """Return points, shape (..., corners, 2), turned about the origin by their angles [rad]."""
    cos, sin = np.cos(angle)[..., None], np.sin(angle)[..., None]
    x, y = points[..., 0], points[..., 1]
    return np.stack([cos * x - sin * y, sin * x + cos * y], axis=-1)
