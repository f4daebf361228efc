"""The braking lead against its closed form."""

import itertools

import pytest

from eigenfail.settings import read_settings
from eigenfail_workers.scenarios.lead_brake import LeadBrake, LeadBrakeParameters


def situation(**parameters):
    return LeadBrake()(read_settings(LeadBrakeParameters, parameters, "scenario_parameters"), 0)


def test_by_hand():
    """From 20 m/s at 4 m/s², beginning at 4 s: 12 m/s after 2 s, 8 m/s from 7 s on."""
    now = situation(speed_mps=20.0, deceleration_mps2=4.0, brakes_at_s=4.0, final_speed_mps=8.0)
    car = now.actors[0]
    assert car.x_m - now.ego.x_m - 10.5 == pytest.approx(60.0)
    speeds = [now.move_actor(0, step, now.ego).speed_mps for step in (0, 40, 60, 70, 150)]
    assert speeds == pytest.approx([20.0, 20.0, 12.0, 8.0, 8.0])
    assert now.move_actor(0, 60, now.ego).x_m - car.x_m == pytest.approx(80.0 + 32.0)
    assert now.move_actor(0, 150, now.ego).x_m - car.x_m == pytest.approx(80.0 + 42.0 + 64.0)


def test_it_starts_as_it_stands_there_and_stays_in_its_lane():
    now = situation()
    states = [now.move_actor(0, step, now.ego) for step in range(now.steps + 1)]
    assert states[0] == now.actors[0]
    assert {(state.y_m, state.heading_rad) for state in states} == {(0.0, 0.0)}
    falls = [before.speed_mps - after.speed_mps for before, after in itertools.pairwise(states)]
    assert max(falls) == pytest.approx(3.5 * now.mission.dt_s)
    assert min(falls) >= 0.0
