"""Signals of a drive, in cases that are worked by hand."""

from math import inf, pi

import numpy as np
import pytest

from eigenfail.errors import SimulatorError
from eigenfail.values.disturbance import NoiseTrajectory
from eigenfail.values.scene import Control, LanePosition, Mission, Observation, VehicleState
from eigenfail.values.signals import NEVER_S, NOBODY_M, SIGNALS
from eigenfail_workers.measures.encounters import find_conflict
from eigenfail_workers.measures.geometry import separation
from eigenfail_workers.measures.signals import (
    CutIns,
    SignalRecorder,
    find_gap,
    find_leader,
    is_preventable,
)
from eigenfail_workers.motion import find_lane
from eigenfail_workers.values import Encounter

LANE = LanePosition(0.0, 4.0)
DT_S = 0.1


def car(x_m: float, y_m: float, speed_mps: float, heading_rad: float = 0.0) -> VehicleState:
    """Return a vehicle of 4 m by 2 m."""
    return VehicleState(x_m, y_m, heading_rad, speed_mps, 4.0, 2.0)


EGO = car(0.0, 0.0, 20.0)


def test_the_gap_is_between_the_fronts() -> None:
    assert find_gap(EGO, car(30.0, 0.0, 10.0)) == 26.0
    assert find_gap(EGO, car(30.0, 0.0, 10.0, pi / 2)) == pytest.approx(27.0)


def test_the_leader_is_the_next_vehicle_ahead_in_the_path() -> None:
    others = (car(60.0, 0.0, 5.0), car(30.0, 1.5, 12.0), car(9.0, 2.5, 8.0), car(-8.0, 0.0, 30.0))
    assert find_leader(EGO, others) == (26.0, 12.0)


def test_without_a_leader_there_is_no_gap() -> None:
    assert find_leader(EGO, (car(30.0, 3.0, 12.0),)) == (NOBODY_M, 20.0)


@pytest.mark.parametrize(
    ("other", "preventable"),
    [
        # 10 m/s of closing speed leave 10 / 12 + 0.35 = 1.183 s: 11.83 m.
        (car(4.0 + 11.9, 0.0, 10.0), True),
        (car(4.0 + 11.7, 0.0, 10.0), False),
        (car(5.0, 0.0, 25.0), True),
        (car(3.0, 0.0, 25.0), False),
    ],
)
def test_a_cut_in_is_preventable_by_the_rule_of_un_r157(
    other: VehicleState, preventable: bool
) -> None:
    assert is_preventable(EGO, other) is preventable


def test_a_vehicle_counts_until_it_is_inside_the_lane_too_late() -> None:
    cut_ins = CutIns()
    # Half of the lane and half of the vehicle are 3 m: at 2.8 m it is 0.2 m inside, at 2.6 m 0.4 m.
    assert not cut_ins.find_excused(EGO, (car(8.0, 4.0, 10.0),), LANE)
    assert not cut_ins.find_excused(EGO, (car(8.0, 2.8, 10.0),), LANE)
    assert cut_ins.find_excused(EGO, (car(8.0, 2.6, 10.0),), LANE) == {0}
    assert cut_ins.find_excused(EGO, (car(30.0, 0.0, 10.0),), LANE) == {0}
    assert not cut_ins.find_excused(EGO, (car(30.0, 4.0, 10.0),), LANE)


def test_a_vehicle_that_wavers_at_the_threshold_has_not_cut_in_anew() -> None:
    cut_ins = CutIns()
    slow = [car(15.5, y_m, 5.0) for y_m in (2.65, 2.75, 2.65)]
    assert [cut_ins.find_excused(EGO, (each,), LANE) for each in slow] == [set()] * 3


def test_vehicles_in_the_lane_at_the_start_have_not_cut_in() -> None:
    cut_ins = CutIns()
    assert not cut_ins.find_excused(EGO, (car(6.0, 0.0, 10.0),), LANE)
    assert not cut_ins.find_excused(EGO, (car(6.0, 0.0, 10.0),), LANE)


def test_a_vehicle_to_whose_lane_the_ego_changes_has_not_cut_in() -> None:
    cut_ins = CutIns()
    other = car(8.0, 4.0, 10.0)
    assert not cut_ins.find_excused(EGO, (other,), LANE)
    changed = car(0.0, 2.5, 20.0)
    assert not cut_ins.find_excused(changed, (other,), LanePosition(-1.5, 4.0))


def test_the_lane_is_the_nearest_that_there_is() -> None:
    mission = Mission(0.1, 2, 4.0, 30.0, 20.0, 500.0, lane_0_ends_x_m=100.0)
    assert find_lane(mission, car(0.0, 0.5, 20.0)) == LanePosition(0.5, 4.0)
    assert find_lane(mission, car(0.0, 3.0, 20.0)) == LanePosition(-1.0, 4.0)
    assert find_lane(mission, car(0.0, 9.0, 20.0)) == LanePosition(5.0, 4.0)
    assert find_lane(mission, car(101.0, 0.5, 20.0)) == LanePosition(-3.5, 4.0)


def record(*course: Observation, wanted: frozenset[str] = frozenset(SIGNALS)) -> SignalRecorder:
    """Return a recorder that has seen a course."""
    recorder = SignalRecorder(wanted)
    for seen in course:
        encounters = []
        for other in seen.others:
            between = separation(seen.ego, other)
            conflict = find_conflict(seen.ego, other, between)
            encounters.append(Encounter(between.distance_m, conflict))
        recorder.observe(seen, encounters)
    return recorder


def see(step: int, ego: VehicleState, applied: Control | None, **changes: bool) -> Observation:
    """Return what is seen after a step, with a vehicle 26 m ahead at the start."""
    other = car(30.0 + step, 0.0, 10.0)
    return Observation(step, ego, (other,), applied=applied, lane=LANE, **changes)


QUIET = NoiseTrajectory(np.zeros((2, 1), np.float32), np.ones((2, 1), np.float32))


def test_a_course_has_a_value_of_each_signal_for_the_start_and_every_step() -> None:
    course = (
        see(0, EGO, None),
        see(1, car(2.0, 0.0, 19.9), Control(-1.0, 0.0)),
        see(2, car(4.0, 0.0, 19.7), Control(-2.0, 0.0)),
    )
    found = record(*course).collect(QUIET, ("speed",), DT_S)
    assert {len(values) for values in found.values()} == {3}
    assert found["gap_m"].tolist() == [26.0, 25.0, 24.0]
    assert found["headway_s"][0] == pytest.approx(1.3)
    assert found["ttc_s"][0] == pytest.approx(2.6)
    assert found["ttc_ahead_s"].tolist() == found["ttc_s"].tolist()
    assert found["drac_mps2"][0] == pytest.approx(100.0 / 52.0)
    assert found["acceleration_mps2"].tolist() == [0.0, -1.0, -2.0]
    assert found["jerk_mps3"] == pytest.approx([0.0, -10.0, -10.0])
    assert found["lane_margin_m"].tolist() == [1.0, 1.0, 1.0]
    assert found["preventable_distance_m"].tolist() == [26.0, 25.0, 24.0]


def test_a_vehicle_behind_is_not_ahead() -> None:
    behind = Observation(0, EGO, (car(-30.0, 0.0, 30.0),), lane=LANE)
    found = record(behind, behind, behind).collect(QUIET, ("speed",), DT_S)
    assert found["ttc_s"][0] == pytest.approx(2.6)
    assert found["ttc_ahead_s"].tolist() == [NEVER_S] * 3


def test_acceleration_follows_from_speed_where_none_is_reported() -> None:
    course = (
        see(0, EGO, None),
        see(1, car(2.0, 0.0, 19.5), None),
        see(2, car(4.0, 0.0, 19.5), None),
    )
    found = record(*course).collect(QUIET, ("speed",), DT_S)
    assert found["acceleration_mps2"] == pytest.approx([0.0, -5.0, 0.0])


def test_a_truck_at_rest_does_not_brake() -> None:
    still = car(0.0, 0.0, 0.0)
    course = (see(0, still, None), see(1, still, Control(-7.0, 0.0)), see(2, still, None))
    found = record(*course).collect(QUIET, ("speed",), DT_S)
    assert found["acceleration_mps2"].tolist() == [0.0, 0.0, 0.0]
    assert found["headway_s"].tolist() == [NEVER_S] * 3


def test_at_a_collision_the_distance_is_zero() -> None:
    touching = Observation(1, EGO, (car(4.0 + 1e-9, 0.0, 10.0),), collided=True, lane=LANE)
    found = record(see(0, EGO, None), touching).collect(QUIET, ("speed",), DT_S)
    assert found["distance_m"][-1] == found["preventable_distance_m"][-1] == 0.0


def test_errors_are_those_of_the_step_just_taken() -> None:
    noise = NoiseTrajectory(np.float32([[1.0], [-2.0]]), np.float32([[0.5], [0.5]]))
    wanted = frozenset({"error.speed"})
    course = [see(step, EGO, None) for step in range(3)]
    found = record(*course, wanted=wanted).collect(noise, ("speed",), DT_S)
    assert {name: values.tolist() for name, values in found.items()} == {
        "error.speed": [0.0, 0.5, -1.0]
    }


def test_a_lane_that_is_needed_must_be_told() -> None:
    nowhere = Observation(0, EGO, (car(30.0, 0.0, 10.0),))
    record(nowhere, wanted=frozenset({"gap_m"}))
    with pytest.raises(SimulatorError, match="lane"):
        record(nowhere, wanted=frozenset({"lane_offset_m"}))


def test_no_signal_is_infinite() -> None:
    alone = Observation(0, EGO, (car(1e7, 50.0, 10.0),), lane=LANE)
    found = record(alone, alone, alone).collect(QUIET, ("speed",), DT_S)
    assert all(abs(values).max() < inf for values in found.values())
