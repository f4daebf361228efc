"""Raw gap acceptance: one look decides."""

from math import inf

import pytest
from msgspec import structs

from eigenfail.values.scene import Perception
from eigenfail_workers.planners import idm

SETTINGS = idm.GapAcceptanceSettings(
    safe_deceleration_mps2=0.25, gap_behind_m=1.0, foresight_s=10.0, turning_room_m=40.0
)
OVER = idm.LaneEndPlan(3.5, inf)


@pytest.fixture
def ramp(mission):
    return structs.replace(mission, lane_0_ends_x_m=300.0)


def keeps_pace(_speed_mps, gap_m, _lead_mps):
    """With 50 m it keeps its speed, and it brakes by 1 m/s² for each metre less."""
    return min(gap_m - 50.0, 0.0)


@pytest.fixture
def accept(ramp, truck, car):
    """What an ego of 20 m/s does about cars at these gaps ahead (+) or behind (-), one by one."""
    ego = structs.replace(truck, speed_mps=20.0)

    def run(*gaps_m, speed_mps=20.0, now=None, y_m=3.5):
        acceptance = now or idm.GapAcceptance(SETTINGS, ramp, keeps_pace)
        cars = [car(gap + (10.5 if gap > 0 else -10.5), y_m) for gap in gaps_m]
        cars = [structs.replace(one, speed_mps=speed_mps) for one in cars]
        return acceptance(Perception(0.0, ego, tuple(cars), tuple(range(1, len(cars) + 1))))

    return run


STAY = idm.LaneEndPlan(0.0, 300.0 - 40.0 - 8.0)


def test_a_free_lane_is_taken(accept):
    assert accept() == OVER
    assert accept(5.0, y_m=0.0) == OVER


def test_ahead_it_asks_the_model_for_no_more_than_safe_braking(accept):
    assert accept(49.76) == OVER
    assert accept(49.74) == STAY


def test_behind_it_asks_that_the_gap_never_falls_below_the_least(accept):
    """Equal speeds: 1 m. Caught up by 2 m/s for 10 s: 1 + 20 m. Left behind: 1 m."""
    assert accept(-1.01) == OVER
    assert accept(-0.99) == STAY
    assert accept(-21.01, speed_mps=22.0) == OVER
    assert accept(-20.99, speed_mps=22.0) == STAY
    assert accept(-1.01, speed_mps=15.0) == OVER
    assert accept(-0.99, speed_mps=15.0) == STAY


def test_who_will_fall_back_behind_its_lead_needs_the_more_room_behind(accept):
    """0.1 m short of its 50 it loses 0.05, 0.0875, then 0.103 m/s for good: 1.0 m in 10 s."""
    assert accept(49.9, -2.01) == OVER
    assert accept(49.9, -1.98) == STAY


def test_one_look_is_enough_and_it_is_not_taken_back(accept, ramp):
    acceptance = idm.GapAcceptance(SETTINGS, ramp, keeps_pace)
    assert accept(30.0, now=acceptance) == STAY
    assert accept(60.0, now=acceptance) == OVER
    assert accept(-0.1, now=acceptance) == OVER


def test_in_a_lane_that_goes_on_there_is_nothing_to_do(mission, ramp, truck):
    seen = Perception(0.0, truck, (), ())
    assert idm.GapAcceptance(SETTINGS, mission, lambda *_: 0.0)(seen) is None
    on_main = Perception(0.0, structs.replace(truck, y_m=3.4), (), ())
    assert idm.GapAcceptance(SETTINGS, ramp, lambda *_: 0.0)(on_main) is None


def test_a_driver_who_finds_no_gap_stops_before_the_lane_ends(ramp, truck, car):
    driver = idm.IntelligentDriver(idm.IntelligentDriver.Settings())
    driver.reset(ramp)
    ego = structs.replace(truck, speed_mps=20.0)
    for _ in range(600):
        beside = structs.replace(car(ego.x_m, 3.5), speed_mps=ego.speed_mps)
        control = driver.act(Perception(0.0, ego, (beside,), (1,)))
        speed = max(ego.speed_mps + 0.1 * control.acceleration_mps2, 0.0)
        ego = structs.replace(ego, x_m=ego.x_m + 0.1 * ego.speed_mps, speed_mps=speed)
        assert control.steering_rad == 0.0
        assert control.acceleration_mps2 > -3.0
    assert ego.speed_mps < 0.1
    assert 250.0 < ego.x_m + 8.0 < 260.0
