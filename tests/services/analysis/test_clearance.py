"""Distances between footprints and times to collision, over a whole scene at once."""

import numpy as np
import pytest

from eigenfail.values.scene import Scene, VehicleState
from eigenfail_services.analysis.footprints import (
    measure_clearances,
    measure_times_to_collision,
)
from eigenfail_workers.measures.encounters import find_conflict
from eigenfail_workers.measures.geometry import separation

SIZES = np.array([[16.0, 2.5], [5.0, 2.0], [4.0, 1.8]], np.float32)


def scene(vehicles):
    vehicles = np.asarray(vehicles, np.float32)
    steps = np.zeros((len(vehicles) - 1, 2), np.float32)
    return Scene(0.1, vehicles, SIZES[: vehicles.shape[1]], steps, steps)


@pytest.mark.parametrize(
    ("pose", "metres"),
    [
        ((20.0, 0.0, 0.0), 9.5),
        ((0.0, 5.0, 0.0), 2.75),
        ((13.5, 5.25, 0.0), np.hypot(3.0, 3.0)),
        ((20.0, 0.0, np.pi / 2), 11.0),
        ((9.0, 0.0, 0.0), 0.0),
        ((0.0, 0.0, 1.0), 0.0),
    ],
)
def test_known_distances(pose, metres):
    found = measure_clearances(scene([[(0.0, 0.0, 0.0, 20.0), (*pose, 20.0)]]))
    assert found == pytest.approx(np.array([[metres]]), abs=1e-5)


def test_they_are_those_that_episodes_are_measured_by():
    rng = np.random.default_rng(3)
    places = rng.uniform((-15, -6, -3), (15, 6, 3), (300, 3, 3))
    vehicles = np.concatenate([places, np.ones((300, 3, 1))], axis=2).astype(np.float32)
    found = measure_clearances(scene(vehicles))
    states = [
        [VehicleState(*map(float, (*v, *s))) for v, s in zip(row, SIZES, strict=True)]
        for row in vehicles
    ]
    wanted = [[separation(row[0], other).distance_m for other in row[1:]] for row in states]
    assert 0 < np.count_nonzero(found) < found.size
    assert found == pytest.approx(np.array(wanted), abs=1e-6)


def test_a_vehicle_that_is_not_there_is_infinitely_far():
    absent = (np.nan,) * 4
    moments = [
        [(0.0, 0.0, 0.0, 20.0), absent, (30.0, 0.0, 0.0, 20.0)],
        [(0.0, 0.0, 0.0, 20.0), (20.0, 0.0, 0.0, 20.0), absent],
    ]
    assert measure_clearances(scene(moments)).tolist() == [[np.inf, 20.0], [9.5, np.inf]]


def test_times_to_collision_are_those_that_episodes_are_measured_by():
    rng = np.random.default_rng(4)
    low, high = (-40, -4, -0.2, 5), (40, 4, 0.2, 35)
    vehicles = rng.uniform(low, high, (300, 3, 4)).astype(np.float32)
    vehicles[::7, 2] = np.nan
    found = measure_times_to_collision(scene(vehicles))
    wanted = [min(times_of(row), default=np.inf) for row in vehicles]
    assert 50 < np.count_nonzero(np.isfinite(found)) < 250
    assert found == pytest.approx(np.array(wanted), rel=1e-4)


def times_of(row):
    """Times to collision of the ego with each vehicle that it is in conflict with."""
    ego, *others = [
        VehicleState(*map(float, (*pose, *size)))
        for pose, size in zip(row, SIZES, strict=True)
        if np.isfinite(pose[0])
    ]
    found = [find_conflict(ego, other, separation(ego, other)) for other in others]
    return [conflict.ttc_s for conflict in found if conflict is not None]
