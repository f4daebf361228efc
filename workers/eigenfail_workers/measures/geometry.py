"""Footprints: oriented rectangles in the road's plane, and how far they are apart."""

from collections.abc import Sequence
from math import cos, hypot, inf, sin

from eigenfail.values import VehicleState
from eigenfail_workers.values import Point, Separation

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


def _nearest_corner(a: VehicleState, b: VehicleState) -> tuple[bool, float, Point]:
    """Find the corner of `b` that is nearest to `a`, in the frame of `a`.

    Returns:
        whether a side of `a` separates the two, the smallest distance from `a` to a corner of `b`,
        and the vector of that distance in the road's plane.
    """
    cos_a, sin_a = cos(a.heading_rad), sin(a.heading_rad)
    half_length, half_width = 0.5 * a.length_m, 0.5 * a.width_m
    ahead = behind = left = right = True
    best, best_x, best_y = inf, 0.0, 0.0
    for x, y in _corners_in_frame(a, b, cos_a, sin_a):
        ahead, behind = ahead and x > half_length, behind and x < -half_length
        left, right = left and y > half_width, right and y < -half_width
        out_x, out_y = _excess(x, half_length), _excess(y, half_width)
        distance = hypot(out_x, out_y)
        if distance < best:
            best, best_x, best_y = distance, out_x, out_y
    vector = cos_a * best_x - sin_a * best_y, sin_a * best_x + cos_a * best_y
    return ahead or behind or left or right, best, vector


def _excess(position: float, half: float) -> float:
    """Part of a position that is outside the range from -half to half."""
    if position > half:
        return position - half
    return position + half if position < -half else 0.0


def _corners_in_frame(
    a: VehicleState, b: VehicleState, cos_a: float, sin_a: float
) -> tuple[Point, Point, Point, Point]:
    """Return the corners of `b` in the frame of `a`: origin at its centre, x axis along it."""
    dx, dy = b.x_m - a.x_m, b.y_m - a.y_m
    centre_x, centre_y = cos_a * dx + sin_a * dy, cos_a * dy - sin_a * dx
    turn = b.heading_rad - a.heading_rad
    cos_turn, sin_turn = cos(turn), sin(turn)
    along_x, along_y = 0.5 * b.length_m * cos_turn, 0.5 * b.length_m * sin_turn
    across_x, across_y = -0.5 * b.width_m * sin_turn, 0.5 * b.width_m * cos_turn
    return (
        (centre_x + along_x + across_x, centre_y + along_y + across_y),
        (centre_x + along_x - across_x, centre_y + along_y - across_y),
        (centre_x - along_x + across_x, centre_y - along_y + across_y),
        (centre_x - along_x - across_x, centre_y - along_y - across_y),
    )


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
