"""Lateral paths, and a truck that is steered along one."""

from math import atan, cos, sin, tan

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import structs

from eigenfail_workers.motion import minimum_jerk
from eigenfail_workers.planners.rulebook.changes import change_way_m, make_straight_path
from eigenfail_workers.planners.rulebook.settings import LateralSettings
from eigenfail_workers.planners.rulebook.values import LateralPath
from eigenfail_workers.planners.steering import look_ahead_m, pursue

SHARES = st.floats(0.0, 1.0)


@given(SHARES)
def test_least_jerk_is_symmetric_about_its_middle(share):
    done, slope = minimum_jerk(share)
    other, same = minimum_jerk(1.0 - share)
    assert done + other == pytest.approx(1.0)
    assert slope == pytest.approx(same)


@given(SHARES, SHARES)
def test_it_never_turns_back(one, other):
    first, last = sorted((one, other))
    assert minimum_jerk(first)[0] <= minimum_jerk(last)[0] + 1e-12


def test_a_path_by_hand():
    path = LateralPath(from_m=0.0, to_m=3.5, begins_x_m=100.0, length_m=80.0)
    assert [path.at(x_m) for x_m in (0.0, 100.0, 140.0, 180.0, 999.0)] == [0.0, 0.0, 1.75, 3.5, 3.5]
    assert path.left_m(150.0) == 30.0
    assert path.left_m(190.0) == -10.0
    assert make_straight_path(1.5).at(-7.0) == make_straight_path(1.5).at(70.0) == 1.5


def test_the_way_of_a_change_takes_its_time_at_speed_and_room_at_none():
    settings = LateralSettings()
    assert change_way_m(20.0, settings) == 20.0 * settings.change_s
    assert change_way_m(0.0, settings) == settings.shortest_m


@pytest.mark.parametrize("speed_mps", [3.0, 12.0, 22.0])
def test_a_truck_follows_it_within_a_hand_s_breadth_and_does_not_overshoot(truck, speed_mps):
    ego = structs.replace(truck, speed_mps=speed_mps)
    path = LateralPath(0.0, 3.5, 0.0, change_way_m(speed_mps, LateralSettings()))
    widest = 0.0
    while ego.x_m < path.length_m + 4.0 * look_ahead_m(ego):
        slip = atan(tan(pursue(ego, path.at(ego.x_m + look_ahead_m(ego)))) / 2)
        course = ego.heading_rad + slip
        ego = structs.replace(
            ego,
            x_m=ego.x_m + ego.speed_mps * cos(course) * 0.1,
            y_m=ego.y_m + ego.speed_mps * sin(course) * 0.1,
            heading_rad=ego.heading_rad + ego.speed_mps * sin(slip) / (ego.length_m / 2) * 0.1,
        )
        widest = max(widest, ego.y_m)
        assert abs(ego.y_m - path.at(ego.x_m)) < 0.6
    assert ego.y_m == pytest.approx(3.5, abs=0.05)
    assert widest < 3.6
