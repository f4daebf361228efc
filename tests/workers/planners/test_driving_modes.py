"""Departure, highway, arrival."""

from math import sqrt

import pytest
from msgspec import structs

from eigenfail_workers.planners.rulebook.driving_modes import ModeMachine
from eigenfail_workers.planners.rulebook.settings import ModeSettings
from eigenfail_workers.planners.rulebook.values import DrivingMode


def test_a_trip_goes_through_all_modes_in_order(mission, truck):
    machine, ego, modes = ModeMachine(ModeSettings(), mission), truck, []
    ego = structs.replace(ego, speed_mps=0.0)
    for _ in range(3000):
        mode, task = machine.update(ego)
        modes.append(mode)
        push = min(max(0.4 * (task.target_mps - ego.speed_mps), -2.0), task.max_acceleration_mps2)
        speed = max(ego.speed_mps + 0.1 * push, 0.0)
        ego = structs.replace(ego, x_m=ego.x_m + 0.1 * ego.speed_mps, speed_mps=speed)
    assert list(dict.fromkeys(modes)) == list(DrivingMode)
    assert ego.x_m == pytest.approx(mission.goal_x_m, abs=5.0)
    assert ego.speed_mps < 0.5


def test_at_speed_it_starts_on_the_highway_and_does_not_depart_again(mission, truck):
    machine = ModeMachine(ModeSettings(), mission)
    assert machine.update(truck)[0] is DrivingMode.HIGHWAY
    assert machine.update(structs.replace(truck, speed_mps=1.0))[0] is DrivingMode.HIGHWAY


def test_arrival_begins_in_time_and_asks_for_a_speed_that_can_still_be_stopped(mission, truck):
    machine = ModeMachine(ModeSettings(), mission)
    braking_m = 24.0**2 / 2.0 + 30.0
    before = structs.replace(truck, x_m=1000.0 - braking_m - 1.0)
    assert machine.update(before)[0] is DrivingMode.HIGHWAY
    mode, task = machine.update(structs.replace(truck, x_m=950.0))
    assert mode is DrivingMode.ARRIVAL
    assert task.target_mps == pytest.approx(sqrt(2 * 50.0) - 2.5)


def test_the_limit_binds_the_desired_speed(mission, truck):
    hasty = structs.replace(mission, desired_speed_mps=30.0)
    assert ModeMachine(ModeSettings(), hasty).update(truck)[1].target_mps == 25.0
