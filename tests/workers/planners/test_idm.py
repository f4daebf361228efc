"""The Intelligent Driver Model against its own paper, and the brakes that it has here."""

from math import sqrt

import numpy as np
import pytest

from eigenfail.values.scene import Perception
from eigenfail_workers.planners.idm import IntelligentDriver


@pytest.fixture
def accelerate(mission, truck):
    """The model's own acceleration for an ego speed and other vehicles: brakes need no time."""

    def act(speed_mps, *others):
        planner = IntelligentDriver(IntelligentDriver.Settings(brake_build_up_mps3=1000.0))
        planner.reset(mission)
        ego = type(truck)(0.0, 0.0, 0.0, speed_mps, truck.length_m, truck.width_m)
        return planner.act(
            Perception(0.0, ego, others, tuple(range(1, len(others) + 1)))
        ).acceleration_mps2

    return act


@pytest.fixture
def course(mission, truck, car):
    """Accelerations at 24 m/s, step by step, for whether a car is seen close ahead or not."""

    def run(planner, seen):
        planner.reset(mission)
        views = [
            Perception(0.1 * i, truck, (car(30.0, 0.0),) * see, (1,) * see)
            for i, see in enumerate(seen)
        ]
        return [planner.act(view).acceleration_mps2 for view in views]

    return run


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
    assert accelerate(24.0, car(8.0, 0.0)) == -7.0


def test_the_brakes_build_up_step_by_step_and_let_go_at_once(course):
    planner = IntelligentDriver(IntelligentDriver.Settings())
    seen = [*[True] * 9, False, True, True]
    expected = [-1.0, -2.0, -3.0, -4.0, -5.0, -6.0, -7.0, -7.0, -7.0, 0.0, -1.0, -2.0]
    assert course(planner, seen) == pytest.approx(expected)
    assert course(planner, [True]) == pytest.approx([-1.0])


def test_a_lead_that_flickers_costs_more_braking_than_its_share(course):
    """Seen in three steps of four: with brakes that need no time, three quarters of the braking."""
    flicker = [True, True, True, False] * 5
    slow = course(IntelligentDriver(IntelligentDriver.Settings()), flicker)
    quick = course(IntelligentDriver(IntelligentDriver.Settings(brake_build_up_mps3=1e3)), flicker)
    assert np.mean(quick) == pytest.approx(-7.0 * 3 / 4)
    assert np.mean(slow) == pytest.approx(-(1 + 2 + 3) / 4)


def test_only_what_is_perceived_ahead_in_the_lane_leads(accelerate, car):
    """In the lane is what the truck would touch: both half widths, 1.25 m and 1 m."""
    assert accelerate(24.0, car(40.0, 2.26)) == pytest.approx(0.0)
    assert accelerate(24.0, car(-40.0, 0.0)) == pytest.approx(0.0)
    assert accelerate(24.0, car(40.0, -2.24)) < -4.0


def test_the_nearest_lead_counts(accelerate, car):
    alone = accelerate(12.0, car(40.0, 0.0))
    assert accelerate(12.0, car(80.0, 0.0), car(40.0, 0.0)) == alone


@pytest.mark.parametrize("offset_m", [-5.0, 0.0, 5.0])
def test_noise_and_nothing_else_makes_it_fail_in_the_cut_in(drive, offset_m):
    """Undisturbed it stops far behind the car; under ordinary noise it often does not stop."""
    place = {"planner": "idm", "distance_m": 58.0 + offset_m}
    rng = np.random.default_rng(5)
    noisy = [drive(rng.normal(size=(100, 2)), **place).is_failure for _ in range(60)]
    assert drive(**place).measures.robustness_m > 8.0
    assert np.mean(noisy) > 0.02
