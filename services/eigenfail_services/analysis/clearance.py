"""How far apart the footprints of a scene are: oriented rectangles in the road's plane."""

import numpy as np
from numpy.typing import NDArray

from eigenfail.values import Scene

Array = NDArray[np.float64]

CORNERS = 0.5 * np.array([(1.0, 1.0), (1.0, -1.0), (-1.0, -1.0), (-1.0, 1.0)])


def measure_clearances(scene: Scene) -> Array:
    """Smallest distance between the ego's footprint and each other vehicle's, at each moment.

    Two rectangles that do not overlap are nearest at a corner of one of them.

    Returns:
        Shape (steps + 1, vehicles - 1); 0 where they touch or overlap. [m]
    """
    vehicles, sizes = scene.vehicles.astype(np.float64), scene.sizes.astype(np.float64)
    ego, others = vehicles[:, :1, :3], vehicles[:, 1:, :3]
    one_apart, one_m = _measure_beside(ego, sizes[:1], others, sizes[1:])
    two_apart, two_m = _measure_beside(others, sizes[1:], ego, sizes[:1])
    return np.where(one_apart | two_apart, np.minimum(one_m, two_m), 0.0)


def _measure_beside(
    a: Array, size_a: Array, b: Array, size_b: Array
) -> tuple[NDArray[np.bool_], Array]:
    """Whether a side of `a` separates the two, and the distance from `a` to a corner of `b`.

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
    """The corners of `b` where the centre of `a` is the origin and its heading the x axis.

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
    """Points, shape (..., corners, 2), turned about the origin by an angle each [rad]."""
    cos, sin = np.cos(angle)[..., None], np.sin(angle)[..., None]
    x, y = points[..., 0], points[..., 1]
    return np.stack([cos * x - sin * y, sin * x + cos * y], axis=-1)
