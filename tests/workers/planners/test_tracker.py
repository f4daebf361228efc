"""The tracker: its filter against a textbook recursion, its gate, the life of a track."""

import numpy as np
import pytest
from msgspec import structs

from eigenfail.values.scene import Perception
from eigenfail_workers.planners.rulebook.settings import TrackerSettings
from eigenfail_workers.planners.rulebook.tracker import AxisFilter, Tracker, TrackState

SETTINGS = TrackerSettings()
OFF = 1000.0


@pytest.fixture
def watch(truck, car):
    """A tracker that watches one car at 60 m for as many steps as errors (x, y) are given."""

    def run(tracker, errors):
        for dx, dy in errors:
            tracks = tracker.update(Perception(0.0, truck, (car(60.0 + dx, 3.5 + dy),), (1,)))
        return tracks

    return run


def still(n):
    return [(0.0, 0.0)] * n


def test_the_filter_is_the_matrix_recursion():
    rng = np.random.default_rng(0)
    axis = AxisFilter(10.0, 2.0, 3.0, 4.0)
    x, p = np.array([10.0, 2.0]), np.diag([9.0, 16.0])
    f, g, h = np.array([[1, 0.1], [0, 1]]), np.array([0.005, 0.1]), np.array([[1.0, 0.0]])
    for measured in rng.normal(12.0, 2.0, 50):
        axis.predict(0.1, 0.3)
        x, p = f @ x, f @ p @ f.T + 0.09 * np.outer(g, g)
        total = (h @ p @ h.T).item() + 4.0
        assert axis.squared_innovation(measured, 4.0) == pytest.approx(
            (measured - x[0]) ** 2 / total
        )
        axis.correct(measured, 4.0)
        gain = (p @ h.T).ravel() / total
        x, p = x + gain * (measured - x[0]), p - np.outer(gain, h @ p)
        assert (axis.position_m, axis.velocity_mps) == pytest.approx(tuple(x))
        assert (axis.p00, axis.p01, axis.p11) == pytest.approx((p[0, 0], p[0, 1], p[1, 1]))


def test_white_noise_is_filtered_away(truck, car):
    """A car that drives on, seen with the paper's sigma: errors far below it, and honest."""
    errors, scaled = [], []
    for seed in range(20):
        rng, tracker = np.random.default_rng(seed), Tracker(SETTINGS, 0.1)
        for step in range(100):
            x_m = 90.0 + (12.0 - 24.0) * 0.1 * step * 0.5
            sigma = 0.02 * x_m + 1.0, 0.00625 * 3.5 + 0.2
            noise = rng.normal(size=2) * sigma
            ego = structs.replace(truck, speed_mps=0.0)
            (track,) = tracker.update(
                Perception(0.0, ego, (car(x_m + noise[0], 3.5 + noise[1]),), (1,))
            )
        errors.append((track.along.position_m - x_m, track.along.velocity_mps + 6.0))
        scaled.append((track.along.position_m - x_m) ** 2 / track.along.p00)
    rms = np.sqrt(np.mean(np.square(errors), axis=0))
    assert rms[0] < 0.4 * sigma[0]
    assert rms[1] < 0.5
    assert 0.3 < np.mean(scaled) < 2.5


def test_birth_confirmation_coasting_and_return(watch):
    tracker = Tracker(SETTINGS, 0.1)
    (track,) = watch(tracker, still(1))
    assert track.state is TrackState.TENTATIVE
    assert not track.is_trusted
    watch(tracker, still(SETTINGS.hits_to_confirm - 2))
    assert track.state is TrackState.TENTATIVE
    watch(tracker, still(1))
    assert track.state is TrackState.CONFIRMED
    watch(tracker, [(OFF, 0.0)] * (SETTINGS.misses_to_delete - 1))
    assert track.state is TrackState.COASTING
    assert track.is_trusted
    watch(tracker, still(1))
    assert track.state is TrackState.CONFIRMED
    assert tracker.lost == 0


def test_a_confirmed_track_is_given_up_after_misses_in_a_row_and_born_again_at_the_truck_s_speed(
    watch, truck
):
    tracker = Tracker(SETTINGS, 0.1)
    (old,) = watch(tracker, still(30))
    assert old.along.velocity_mps == pytest.approx(0.0, abs=1.0)
    assert watch(tracker, [(OFF, 0.0)] * SETTINGS.misses_to_delete) == []
    assert old.state is TrackState.DELETED
    assert tracker.lost == 1
    (new,) = watch(tracker, still(1))
    assert new is not old
    assert new.along.velocity_mps == truck.speed_mps
    assert new.along.p11 == pytest.approx(SETTINGS.again_speed_sd_mps**2)


def test_a_tentative_track_is_given_up_sooner_and_is_no_loss(watch):
    tracker = Tracker(SETTINGS, 0.1)
    watch(tracker, still(2))
    assert watch(tracker, [(OFF, 0.0)] * SETTINGS.tentative_misses) == []
    assert tracker.lost == 0
    (again,) = watch(tracker, still(1))
    assert again.along.p11 == pytest.approx(SETTINGS.first_speed_sd_mps**2)


def test_the_gate_is_on_the_sum_of_both_axes(watch):
    """Either error alone would pass; together they do not. The estimate stays untouched."""
    tracker = Tracker(SETTINGS, 0.1)
    (track,) = watch(tracker, still(50))
    along = 2.4 * np.sqrt(track.along.p00 + (0.02 * 60 + 1) ** 2)
    across = 2.4 * np.sqrt(track.across.p00 + (0.00625 * 3.5 + 0.2) ** 2)
    watch(tracker, [(along, 0.0)])
    assert track.misses == 0
    watch(tracker, [*still(20), (0.0, across)])
    assert track.misses == 0
    watch(tracker, [*still(20), (along, across)])
    assert track.misses == 1


def test_a_vehicle_that_is_not_detected_is_a_miss(truck, car):
    """Its track coasts, is given up, and is born again with the vehicle's number, alone of all."""
    tracker, near, far = Tracker(SETTINGS, 0.1), car(40.0, 3.5), car(90.0, 0.0)
    for _ in range(30):
        one, other = tracker.update(Perception(0.0, truck, (near, far), (1, 2)))
    certain_m2 = one.along.p00
    for _ in range(SETTINGS.misses_to_delete - 1):
        tracker.update(Perception(0.0, truck, (far,), (2,)))
    assert (one.state, other.state) == (TrackState.COASTING, TrackState.CONFIRMED)
    assert one.along.p00 > certain_m2
    assert tracker.update(Perception(0.0, truck, (far,), (2,))) == [other]
    assert (one.state, tracker.lost) == (TrackState.DELETED, 1)
    _, again = tracker.update(Perception(0.0, truck, (near, far), (1, 2)))
    assert again is not one
    assert again.along.p11 == pytest.approx(SETTINGS.again_speed_sd_mps**2)
