"""The Intelligent Driver Model against its own paper."""

from math import sqrt

import pytest

from eigenfail.values import Perception
from eigenfail_workers.planners.idm import IntelligentDriver


@pytest.fixture
def accelerate(mission, truck):
    """The model's acceleration for an ego speed and other vehicles."""

    def act(speed_mps, *others):
        planner = IntelligentDriver(IntelligentDriver.Settings())
        planner.reset(mission)
        ego = type(truck)(0.0, 0.0, 0.0, speed_mps, truck.length_m, truck.width_m)
        return planner.act(Perception(0.0, ego, others)).acceleration_mps2

    return act


def test_free_road(accelerate):
    assert accelerate(0.0) == pytest.approx(0.8)
    assert accelerate(12.0) == pytest.approx(0.8 * (1 - 0.5**4))
    assert accelerate(24.0) == pytest.approx(0.0)


def test_equilibrium_gap_behind_a_lead_of_equal_speed(accelerate, car):
    gap = (2.0 + 12.0 * 1.5) / sqrt(1 - 0.5**4)
    assert accelerate(12.0, car(gap + 10.5, 0.0)) == pytest.approx(0.0, abs=1e-9)


def test_closing_in_by_hand(accelerate, car):
    wanted = 2.0 + 24.0 * 1.5 + 24.0 * 12.0 / (2 * sqrt(0.8 * 2.0))
    expected = -0.8 * (wanted / 100.0) ** 2
    assert accelerate(24.0, car(110.5, 0.0)) == pytest.approx(expected)


def test_braking_is_limited_even_where_the_perceived_gap_is_gone(accelerate, car):
    assert accelerate(24.0, car(8.0, 0.0)) == -5.0


def test_only_what_is_perceived_ahead_in_the_lane_leads(accelerate, car):
    assert accelerate(24.0, car(40.0, 1.79)) == pytest.approx(0.0)
    assert accelerate(24.0, car(-40.0, 0.0)) == pytest.approx(0.0)
    assert accelerate(24.0, car(40.0, -1.77)) < -4.0


def test_the_nearest_lead_counts(accelerate, car):
    alone = accelerate(12.0, car(40.0, 0.0))
    assert accelerate(12.0, car(80.0, 0.0), car(40.0, 0.0)) == alone
