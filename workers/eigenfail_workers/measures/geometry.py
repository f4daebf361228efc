"""Footprints: oriented rectangles in the road's plane, and how far they are apart."""

from collections.abc import Sequence
from math import atan2, cos, hypot, inf, pi, sin
from typing import NamedTuple

from eigenfail.values.scene import VehicleState
from eigenfail_workers.values import Point, Separation

CONTACT = Separation(0.0, (0.0, 0.0))


def find_nearest(ego: VehicleState, others: Sequence[VehicleState]) -> int:
    """Return the index of the actor: the vehicle whose centre is nearest to the ego's centre.

    The disturbance model also measures distances between centres. If several vehicles are nearest,
    the first one is returned.
    """
    if len(others) == 1:
        return 0
    distances = [hypot(other.x_m - ego.x_m, other.y_m - ego.y_m) for other in others]
    return distances.index(min(distances))


def find_struck(ego: VehicleState, others: Sequence[VehicleState]) -> int:
    """Return the index of the vehicle that the ego touches: the one at the smallest distance.

    If several vehicles overlap the ego, the one whose circumcircle overlaps the ego's most counts.
    """
    return min(range(len(others)), key=lambda vehicle: _closeness(ego, others[vehicle]))


def _closeness(ego: VehicleState, other: VehicleState) -> tuple[float, float]:
    """Return a sort key: distance of footprints; for overlapping ones, of their circles."""
    return separation(ego, other).distance_m, distance_lower_bound(ego, other)


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
        # If all corners of `b` lie beyond one side of `a`, that side separates the two. By the
        # separating axis theorem two rectangles are apart if, and only if, one of them has such a
        # side.
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


class _View(NamedTuple):
    """A footprint as the sensor sees it.

    Attributes:
        towards_rad: direction of its centre in the road's plane.
        first_rad: direction of the footprint's first edge from `towards_rad`, below 0; `last_rad`
            is the direction of its last edge, above 0.
    """

    towards_rad: float
    first_rad: float
    last_rad: float


def find_hidden(ego: VehicleState, others: Sequence[VehicleState]) -> set[int]:
    """Return the indexes of the vehicles that the ego's sensor cannot see.

    The sensor is at the centre of the ego's front and looks in all directions. A vehicle is hidden
    if every ray to its footprint first meets another footprint; the ego itself hides nothing. Two
    footprints that do not overlap have the same order along all rays that meet both. So one ray
    shows which footprint is in front. A vehicle at the sensor itself is seen, and hides nothing.
    """
    half_length = 0.5 * ego.length_m
    x = ego.x_m + half_length * cos(ego.heading_rad)
    y = ego.y_m + half_length * sin(ego.heading_rad)
    views = [_view(x, y, other) for other in others]
    hidden = set()
    for number, view in enumerate(views):
        if view is None:
            continue
        covered: list[Point] = []
        for place, cover in enumerate(views):
            if place != number and cover is not None:
                covered += _cover(x, y, (others[number], view), (others[place], cover))
        if _is_covered(view, covered):
            hidden.add(number)
    return hidden


def _view(x: float, y: float, vehicle: VehicleState) -> _View | None:
    """Return how a footprint is seen from a point; None from within or at its edge."""
    cos_v, sin_v = cos(vehicle.heading_rad), sin(vehicle.heading_rad)
    dx, dy = vehicle.x_m - x, vehicle.y_m - y
    along, across = abs(cos_v * dx + sin_v * dy), abs(cos_v * dy - sin_v * dx)
    if along <= 0.5 * vehicle.length_m and across <= 0.5 * vehicle.width_m:
        return None
    towards_rad = atan2(dy, dx)
    turns = []
    for ahead in (0.5 * vehicle.length_m, -0.5 * vehicle.length_m):
        for left in (0.5 * vehicle.width_m, -0.5 * vehicle.width_m):
            corner_x = dx + cos_v * ahead - sin_v * left
            corner_y = dy + sin_v * ahead + cos_v * left
            turns.append(_wrap(atan2(corner_y, corner_x) - towards_rad))
    return _View(towards_rad, min(turns), max(turns))


def _wrap(angle_rad: float) -> float:
    """Return an angle between two directions as -pi … pi."""
    if angle_rad > pi:
        return angle_rad - 2.0 * pi
    return angle_rad + 2.0 * pi if angle_rad < -pi else angle_rad


def _cover(
    x: float, y: float, back: tuple[VehicleState, _View], front: tuple[VehicleState, _View]
) -> list[Point]:
    """Return the part of a view that another vehicle hides, from the direction of its centre."""
    view, cover = back[1], front[1]
    turn = _wrap(cover.towards_rad - view.towards_rad)
    found = []
    # Two views may meet on the far side, too, where one of them is wide.
    for around in (-2.0 * pi, 0.0, 2.0 * pi):
        begin = max(view.first_rad, turn + around + cover.first_rad)
        end = min(view.last_rad, turn + around + cover.last_rad)
        if begin >= end:
            continue
        ray = view.towards_rad + 0.5 * (begin + end)
        if _measure_ray(x, y, ray, front[0]) < _measure_ray(x, y, ray, back[0]):
            found.append((begin, end))
    return found


def _measure_ray(x: float, y: float, ray_rad: float, vehicle: VehicleState) -> float:
    """Return the distance from a point to the entry of a ray into a footprint. [m]

    The ray must meet the footprint.
    """
    # The slab method: in the frame of the footprint, the ray is inside once it is within both
    # ranges.
    turn, dx, dy = ray_rad - vehicle.heading_rad, x - vehicle.x_m, y - vehicle.y_m
    cos_v, sin_v = cos(vehicle.heading_rad), sin(vehicle.heading_rad)
    return max(
        _measure_slab(cos_v * dx + sin_v * dy, cos(turn), 0.5 * vehicle.length_m),
        _measure_slab(cos_v * dy - sin_v * dx, sin(turn), 0.5 * vehicle.width_m),
    )


def _measure_slab(start_m: float, cosine: float, half_m: float) -> float:
    """Return the distance along a ray to its entry into the range from -half_m to half_m. [m]

    It is -inf if the ray is parallel to the range.

    Args:
        start_m: start of the ray on the axis of the range.
        cosine: cosine of the angle between the ray and that axis.
        half_m: half of the range.
    """
    # A parallel ray meets the footprint, so that it is within the range throughout.
    if cosine == 0.0:
        return -inf
    edge_m = -half_m if cosine > 0.0 else half_m
    return (edge_m - start_m) / cosine


def _is_covered(view: _View, intervals: list[Point]) -> bool:
    """Return whether intervals leave nothing of a view."""
    reached = view.first_rad
    for begin, end in sorted(intervals):
        if begin > reached:
            return False
        reached = max(reached, end)
    return reached >= view.last_rad


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
