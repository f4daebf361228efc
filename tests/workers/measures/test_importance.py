"""Importance functions: how close a step is to a collision."""

import numpy as np
import pytest

from eigenfail.values.episode import Importance
from eigenfail.values.scene import Control, Observation, VehicleState
from eigenfail_workers.measures.importance import Approach, compute_importance
from eigenfail_workers.measures.recorder import Recorder
from eigenfail_workers.values import Encounter, TrafficConflict

AT_50_M = Encounter(50.0, TrafficConflict(ttc_s=5.0, drac_mps2=1.0))  # closing at 10 m/s
AT_30_M = Encounter(30.0, TrafficConflict(ttc_s=6.0, drac_mps2=5.0**2 / 60.0))
AWAY = Encounter(12.0, None)


@pytest.mark.parametrize(
    ("acceleration", "expected"),
    [
        (0.0, 10.0**2 / (2.0 * 40.0)),  # after 10 m
        (-4.0, 6.0**2 / (2.0 * 42.0)),  # after 10 − 2 m
        (2.0, 12.0**2 / (2.0 * 39.0)),
        (-20.0, 0.0),  # it closes in no more
    ],
)
def test_required_braking_is_that_of_a_second_later(acceleration, expected):
    approach = Approach((AT_50_M, AWAY), acceleration)
    assert compute_importance(Importance.REQUIRED_BRAKING, approach) == pytest.approx(expected)


def test_the_most_urgent_vehicle_counts():
    approach = Approach((AT_30_M, AT_50_M, AWAY), 0.0)
    assert compute_importance(Importance.REQUIRED_BRAKING, approach) == pytest.approx(1.25)
    assert compute_importance(Importance.TIME_TO_COLLISION, approach) == pytest.approx(0.2)
    assert compute_importance(Importance.DISTANCE, approach) == pytest.approx(-12.0)


def test_without_a_conflict_nothing_is_required():
    approach = Approach((AWAY,), -1.0)
    assert compute_importance(Importance.REQUIRED_BRAKING, approach) == 0.0
    assert compute_importance(Importance.TIME_TO_COLLISION, approach) == 0.0


def test_a_gap_that_will_be_closed_within_a_second_counts_most():
    near = Approach((Encounter(4.0, TrafficConflict(ttc_s=0.4, drac_mps2=12.5)),), 0.0)
    assert 1e2 < compute_importance(Importance.REQUIRED_BRAKING, near) < 1e5


def drive(recorder):
    """Drive towards a standing car: 10 m/s, from a gap of 45 m, braking in the last step."""
    car = VehicleState(50.0, 0.0, 0.0, 0.0, 5.0, 2.0)
    for step, (x_m, applied) in enumerate([(0.0, None), (1.0, 0.0), (2.0, -4.0)]):
        ego = VehicleState(x_m, 0.0, 0.0, 10.0, 5.0, 2.0)
        control = None if applied is None else Control(applied, 0.0)
        recorder.observe(Observation(step, ego, (car,), control=control, applied=control), 0.1)
        if step < 2:
            recorder.add_disturbance((0.0, 0.0), (1.0, 1.0))


def test_it_is_recorded_after_each_step():
    recorder = Recorder(importance=Importance.REQUIRED_BRAKING)
    drive(recorder)
    first, second = recorder.importance()
    assert first == pytest.approx(10.0**2 / (2.0 * 34.0))
    assert second == pytest.approx(6.0**2 / (2.0 * 35.0))
    assert recorder.importance().dtype == np.float32


def test_it_is_not_recorded_where_nobody_asks():
    recorder = Recorder()
    drive(recorder)
    assert recorder.importance() is None
