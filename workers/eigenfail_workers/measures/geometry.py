"""Footprints: oriented rectangles in the road's plane, and how far they are apart."""

from collections.abc import Iterator, Sequence
from math import copysign, cos, hypot, inf, sin
from typing import NamedTuple

from eigenfail.values import VehicleState


class Separation(NamedTuple):
    """Distance and direction between two footprints.

    Attributes:
        distance_m: smallest distance between them; 0 if they touch or overlap.
        direction: unit vector along the line of nearest points, from the first footprint to the
            second; (0, 0) if they touch or overlap.
    """

    distance_m: float
    direction: tuple[float, float]


CONTACT = Separation(0.0, (0.0, 0.0))


def find_nearest(ego: VehicleState, others: Sequence[VehicleState]) -> int:
    """Return the index of the actor: the vehicle whose centre is nearest to the ego's centre.

    The disturbance model's distances are between centres, too. Of equals the first is returned.
    """
    if len(others) == 1:
        return 0
    distances = [hypot(other.x_m - ego.x_m, other.y_m - ego.y_m) for other in others]
    return distances.index(min(distances))


def distance_lower_bound(a: VehicleState, b: VehicleState) -> float:
    """Lower bound of the distance between two footprints, from their circumcircles. [m]"""
    centres = hypot(b.x_m - a.x_m, b.y_m - a.y_m)
    return centres - 0.5 * (hypot(a.length_m, a.width_m) + hypot(b.length_m, b.width_m))


def separation(a: VehicleState, b: VehicleState) -> Separation:
    """Return the distance between two footprints and its direction.

    Two convex polygons that do not overlap are nearest at a corner of one of them.
    """
    apart_a, gap_a, to_b = _nearest_corner(a, b)
    apart_b, gap_b, to_a = _nearest_corner(b, a)
    gap = min(gap_a, gap_b)
    if gap == 0.0 or not (apart_a or apart_b):
        return CONTACT
    x, y = to_b if gap_a <= gap_b else (-to_a[0], -to_a[1])
    return Separation(gap, (x / gap, y / gap))


def _nearest_corner(a: VehicleState, b: VehicleState) -> tuple[bool, float, tuple[float, float]]:
    """Find the corner of `b` that is nearest to `a`, in the frame of `a`.

    Returns:
        whether a side of `a` separates the two, the smallest distance from `a` to a corner of `b`,
        and the vector of that distance in the road's plane.
    """
    cos_a, sin_a = cos(a.heading_rad), sin(a.heading_rad)
    half_length, half_width = 0.5 * a.length_m, 0.5 * a.width_m
    corners = tuple(_corners_in_frame(a, b, cos_a, sin_a))
    xs, ys = [x for x, _ in corners], [y for _, y in corners]
    apart = (
        min(xs) > half_length
        or max(xs) < -half_length
        or min(ys) > half_width
        or max(ys) < -half_width
    )
    best, best_x, best_y = inf, 0.0, 0.0
    for x, y in corners:
        out_x = copysign(max(abs(x) - half_length, 0.0), x)
        out_y = copysign(max(abs(y) - half_width, 0.0), y)
        distance = hypot(out_x, out_y)
        if distance < best:
            best, best_x, best_y = distance, out_x, out_y
    return apart, best, (cos_a * best_x - sin_a * best_y, sin_a * best_x + cos_a * best_y)


def _corners_in_frame(
    a: VehicleState, b: VehicleState, cos_a: float, sin_a: float
) -> Iterator[tuple[float, float]]:
    """Yield the corners of `b` in the frame of `a`: origin at its centre, x axis along it."""
    dx, dy = b.x_m - a.x_m, b.y_m - a.y_m
    centre_x, centre_y = cos_a * dx + sin_a * dy, cos_a * dy - sin_a * dx
    turn = b.heading_rad - a.heading_rad
    cos_turn, sin_turn = cos(turn), sin(turn)
    along_x, along_y = 0.5 * b.length_m * cos_turn, 0.5 * b.length_m * sin_turn
    across_x, across_y = -0.5 * b.width_m * sin_turn, 0.5 * b.width_m * cos_turn
    yield centre_x + along_x + across_x, centre_y + along_y + across_y
    yield centre_x + along_x - across_x, centre_y + along_y - across_y
    yield centre_x - along_x + across_x, centre_y - along_y + across_y
    yield centre_x - along_x - across_x, centre_y - along_y - across_y


def half_width_across_road(vehicle: VehicleState) -> float:
    """Half of the extent of a footprint along the road's lateral axis. [m]"""
    along = vehicle.length_m * abs(sin(vehicle.heading_rad))
    return 0.5 * (along + vehicle.width_m * abs(cos(vehicle.heading_rad)))


def velocity(vehicle: VehicleState) -> tuple[float, float]:
    """Velocity of a vehicle in the road's plane. [m/s]"""
    return (
        vehicle.speed_mps * cos(vehicle.heading_rad),
        vehicle.speed_mps * sin(vehicle.heading_rad),
    )
