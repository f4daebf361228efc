"""Intent: evidence, commitment, letting go."""

import pytest

from eigenfail_workers.planners.rulebook.settings import IntentSettings
from eigenfail_workers.planners.rulebook.tracker import AxisFilter, Track, update_intent

SETTINGS = IntentSettings()


@pytest.fixture
def judged(truck, car):
    """Judge a track of some age at a lateral position, so often."""

    def run(track, y_m, times, vy_mps=0.0, age=100):
        track.across.position_m, track.across.velocity_mps, track.age = y_m, vy_mps, age
        for _ in range(times):
            update_intent(track, truck, 0.1, SETTINGS)
        return track.leads

    return run


@pytest.fixture
def track(car):
    return Track(AxisFilter(60.0, 12.0, 1.0, 1.0), AxisFilter(3.5, 0.0, 0.2, 0.2), car(60.0, 3.5))


def test_it_commits_only_after_enough_evidence_and_lets_go_only_when_none_is_left(judged, track):
    assert not judged(track, 1.0, SETTINGS.commit - 1)
    assert judged(track, 1.0, 1)
    assert judged(track, 3.5, SETTINGS.commit - 1)
    assert not judged(track, 3.5, 1)


def test_between_the_bounds_nothing_changes(judged, track):
    assert judged(track, 1.0, SETTINGS.commit)
    assert judged(track, 2.2, 50)


def test_it_looks_ahead(judged, track):
    assert not judged(track, 3.0, 10, vy_mps=0.0)
    assert judged(track, 3.0, 10, vy_mps=-1.2)


def test_young_tracks_are_not_judged(judged, track):
    assert not judged(track, 0.0, 50, age=14)
    assert judged(track, 0.0, 50, age=16)
