"""Distances of footprints: hand-worked, invariant, and against another way to compute them."""

from collections.abc import Callable
from math import cos, hypot, pi, sin, sqrt

import msgspec
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from eigenfail.values.scene import VehicleState
from eigenfail_workers.measures.geometry import (
    distance_lower_bound,
    find_nearest,
    half_width_across_road,
    separation,
    velocity,
)

Distance = Callable[[VehicleState, VehicleState], float]

near = st.floats(-30.0, 30.0)
angle = st.floats(-pi, pi)
vehicles = st.builds(
    VehicleState, near, near, angle, st.floats(0.0, 40.0), st.floats(0.5, 20.0), st.floats(0.5, 4.0)
)
relaxed = settings(
    deadline=None,
    derandomize=True,
    max_examples=150,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)


def box(x: float, y: float, heading: float = 0.0, length: float = 4.0, width: float = 2.0):
    return VehicleState(x, y, heading, 0.0, length, width)


@pytest.mark.parametrize(
    ("other", "distance", "direction"),
    [
        (box(10.0, 0.0), 6.0, (1.0, 0.0)),
        (box(-10.0, 0.5), 6.0, (-1.0, 0.0)),
        (box(0.0, 5.0), 3.0, (0.0, 1.0)),
        (box(8.0, 5.0), 5.0, (0.8, 0.6)),
        (box(10.0, 0.0, pi / 2), 7.0, (1.0, 0.0)),
        # a square on its tip: its half-diagonal reaches sqrt(2) towards the other
        (box(10.0, 0.0, pi / 4, 2.0, 2.0), 8.0 - sqrt(2.0), (1.0, 0.0)),
        (box(3.0, 1.0), 0.0, (0.0, 0.0)),
        (box(4.0, 0.0), 0.0, (0.0, 0.0)),
        (box(0.0, 0.0, 0.3, 0.5, 0.5), 0.0, (0.0, 0.0)),
        # a cross: no corner of one lies in the other
        (box(0.0, 0.0, pi / 2), 0.0, (0.0, 0.0)),
    ],
)
def test_hand_worked(other: VehicleState, distance: float, direction: tuple[float, float]) -> None:
    between = separation(box(0.0, 0.0), other)
    assert between.distance_m == pytest.approx(distance, abs=1e-12)
    assert between.direction == pytest.approx(direction, abs=1e-12)


@relaxed
@given(vehicles, vehicles)
def test_agrees_with_all_edges(edge_distance: Distance, a: VehicleState, b: VehicleState) -> None:
    assert separation(a, b).distance_m == pytest.approx(edge_distance(a, b), abs=1e-6)


@relaxed
@given(vehicles, vehicles)
def test_is_symmetric(a: VehicleState, b: VehicleState) -> None:
    there, back = separation(a, b), separation(b, a)
    assert there.distance_m == back.distance_m
    if there.distance_m > 1e-6:
        assert hypot(*there.direction) == pytest.approx(1.0)


@relaxed
@given(vehicles, vehicles, angle, near, near)
def test_survives_rigid_motion(
    a: VehicleState, b: VehicleState, turn: float, dx: float, dy: float
) -> None:
    def moved(v: VehicleState) -> VehicleState:
        x = cos(turn) * v.x_m - sin(turn) * v.y_m + dx
        y = sin(turn) * v.x_m + cos(turn) * v.y_m + dy
        return msgspec.structs.replace(v, x_m=x, y_m=y, heading_rad=v.heading_rad + turn)

    before, after = separation(a, b), separation(moved(a), moved(b))
    assert after.distance_m == pytest.approx(before.distance_m, abs=1e-9)


@relaxed
@given(vehicles, vehicles, st.floats(0.0, 3.0))
def test_grows_no_larger_with_the_footprint(a: VehicleState, b: VehicleState, more: float) -> None:
    larger = msgspec.structs.replace(a, length_m=a.length_m + more, width_m=a.width_m + more)
    assert separation(larger, b).distance_m <= separation(a, b).distance_m + 1e-9


@relaxed
@given(vehicles, vehicles, st.floats(0.01, 20.0))
def test_moving_away_along_the_line_adds_the_way(
    a: VehicleState, b: VehicleState, way: float
) -> None:
    between = separation(a, b)
    if between.distance_m < 1e-3:
        return
    x, y = between.direction
    away = msgspec.structs.replace(b, x_m=b.x_m + way * x, y_m=b.y_m + way * y)
    assert separation(a, away).distance_m == pytest.approx(between.distance_m + way, abs=1e-6)


@relaxed
@given(vehicles, vehicles)
def test_circles_bound_from_below(a: VehicleState, b: VehicleState) -> None:
    assert distance_lower_bound(a, b) <= separation(a, b).distance_m + 1e-9


def test_nearest_is_by_centres_and_takes_the_first_of_equals() -> None:
    ego = box(0.0, 0.0)
    long_but_far = box(12.0, 0.0, length=18.0)
    assert find_nearest(ego, (box(50.0, 0.0),)) == 0
    assert find_nearest(ego, (long_but_far, box(0.0, -11.0), box(0.0, 11.0))) == 1


def test_extent_across_the_road_turns_with_the_vehicle() -> None:
    assert half_width_across_road(box(0.0, 0.0)) == pytest.approx(1.0)
    assert half_width_across_road(box(0.0, 0.0, pi / 2)) == pytest.approx(2.0)
    assert half_width_across_road(box(0.0, 0.0, -pi / 6)) == pytest.approx(1.0 + sqrt(3.0) / 2.0)


def test_velocity_points_where_the_vehicle_does() -> None:
    assert velocity(VehicleState(0.0, 0.0, pi / 6, 10.0, 4.0, 2.0)) == pytest.approx(
        (10.0 * sqrt(3.0) / 2.0, 5.0)
    )
