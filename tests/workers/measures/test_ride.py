"""Jerk, hard braking and clipping, worked out by hand; and what holds for any ride."""

from collections.abc import Sequence

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eigenfail.values.scene import Control, Observation, VehicleState
from eigenfail_workers.measures.recorder import RideMonitor

CAR = (VehicleState(90.0, 0.0, 0.0, 10.0, 4.0, 2.0),)
many = settings(deadline=None, derandomize=True, max_examples=200)
accelerations = st.lists(st.floats(-7.0, 1.5), min_size=1, max_size=40)


def ego(speed_mps: float) -> VehicleState:
    return VehicleState(0.0, 0.0, 0.0, speed_mps, 16.0, 2.5)


def ridden(applied: Sequence[float], speeds: Sequence[float] | None = None) -> RideMonitor:
    """A ride by these accelerations, each asked for as it was applied, at these speeds before."""
    ride = RideMonitor()
    fast = list(speeds or [20.0] * len(applied))
    ride.observe(Observation(0, ego(fast[0]), CAR))
    for step, acceleration in enumerate(applied):
        done = Control(acceleration, 0.0)
        after = ego(fast[min(step + 1, len(fast) - 1)])
        ride.observe(Observation(step + 1, after, CAR, control=done, applied=done))
    return ride


def test_jerk_is_the_largest_change_by_time() -> None:
    # changes: -1, -2.5, +4, 0
    assert ridden([-1.0, -3.5, 0.5, 0.5]).max_jerk_mps3(0.1) == pytest.approx(40.0)
    assert ridden([-1.0, -3.5, 0.5, 0.5]).max_jerk_mps3(0.2) == pytest.approx(20.0)


def test_the_first_step_starts_from_steady_driving() -> None:
    assert ridden([-2.0, -2.0]).max_jerk_mps3(0.1) == pytest.approx(20.0)
    assert ridden([0.0, 0.0]).max_jerk_mps3(0.1) == 0.0


def test_each_entry_into_hard_braking_counts_once() -> None:
    assert ridden([-3.0, -3.0]).hard_brakings == 0
    assert ridden([-3.1, -5.0, -7.0, -3.1]).hard_brakings == 1
    assert ridden([-3.1, -3.0, -3.1, 1.0, -4.0]).hard_brakings == 3


def test_a_truck_at_rest_brakes_no_more() -> None:
    stop_and_press_again = [-7.0, -7.0, 0.0, -7.0]
    assert ridden(stop_and_press_again, [1.0, 0.3, 0.0, 0.0]).hard_brakings == 1
    assert ridden(stop_and_press_again, [9.0, 8.3, 7.6, 7.6]).hard_brakings == 2


def test_clipped_steps_are_those_with_another_control_than_asked_for() -> None:
    ride = RideMonitor()
    ride.observe(Observation(0, ego(20.0), CAR))
    asked = [Control(-9.0, 0.0), Control(-7.0, 0.0), Control(-7.0, 2.0), Control(0.0, 0.0)]
    applied = [Control(-7.0, 0.0), Control(-7.0, 0.0), Control(-7.0, 0.7), Control(0.0, 0.0)]
    for step, (wish, done) in enumerate(zip(asked, applied, strict=True)):
        ride.observe(Observation(step + 1, ego(20.0), CAR, control=wish, applied=done))
    assert ride.clipped_steps == 2


def test_a_simulator_that_does_not_tell_gives_no_figures() -> None:
    ride = RideMonitor()
    ride.observe(Observation(0, ego(20.0), CAR))
    ride.observe(Observation(1, ego(20.0), CAR, control=Control(-9.0, 0.0)))
    assert ride.max_jerk_mps3(0.1) is ride.hard_brakings is ride.clipped_steps is None


@many
@given(accelerations, st.integers(1, 40))
def test_a_longer_ride_is_never_smoother(applied: list[float], cut: int) -> None:
    part, whole = ridden(applied[:cut]), ridden(applied)
    assert part.max_jerk_mps3(0.1) <= whole.max_jerk_mps3(0.1)
    assert part.hard_brakings <= whole.hard_brakings


@many
@given(accelerations)
def test_jerk_does_not_know_forwards_from_backwards(applied: list[float]) -> None:
    mirrored = [-acceleration for acceleration in applied]
    assert ridden(mirrored).max_jerk_mps3(0.1) == ridden(applied).max_jerk_mps3(0.1)


@many
@given(accelerations)
def test_waiting_adds_no_jerk_and_no_braking(applied: list[float]) -> None:
    ride, held = ridden(applied), ridden([*applied, applied[-1]])
    assert held.max_jerk_mps3(0.1) == ride.max_jerk_mps3(0.1)
    assert held.hard_brakings == ride.hard_brakings


@many
@given(accelerations)
def test_braking_begins_at_most_every_second_step(applied: list[float]) -> None:
    assert ridden(applied).hard_brakings <= (len(applied) + 1) // 2
