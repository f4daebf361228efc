"""Which gaps there are, and what they are called."""

import pytest
from hypothesis import given
from hypothesis import strategies as st

from eigenfail.values.scene import VehicleState
from eigenfail_workers.planners.rulebook.settings import GapSettings
from eigenfail_workers.planners.rulebook.tracker import AxisFilter, Track, TrackState
from eigenfail_workers.planners.rulebook.traffic import GapFinder

TRUCK = VehicleState(100.0, 0.0, 0.0, 20.0, 16.0, 2.5)
FINDER = GapFinder(GapSettings(), centre_m=3.5, lane_width_m=3.5, dt_s=0.1)


def track(x_m, y_m=3.5, age=50, state=TrackState.CONFIRMED):
    """A car of 5 m at 21 m/s."""
    seen = VehicleState(x_m, y_m, 0.0, 21.0, 5.0, 2.0)
    found = Track(AxisFilter(x_m, 21.0, 1.0, 1.0), AxisFilter(y_m, 0.0, 0.2, 0.2), seen)
    found.age, found.state = age, state
    return found


def gaps(*tracks):
    """Name → the distances ahead and behind, None where nobody bounds the gap."""
    options = FINDER.find_gaps(tracks, TRUCK)
    return {
        name: (gap.ahead and gap.ahead.gap_m, gap.behind and gap.behind.gap_m)
        for name, gap in options.items()
    }


def test_an_empty_lane_is_free():
    assert gaps() == {"change_lane": (None, None)}
    assert gaps(track(150.0, y_m=0.0)) == {"change_lane": (None, None)}


def test_with_somebody_behind_it_is_ahead_of_them_or_after_them():
    """Centres 30 m behind and 60 m ahead: 10.5 m of that are half a truck and half a car."""
    assert gaps(track(70.0), track(160.0), track(40.0)) == {
        "merge_early": (49.5, 19.5),
        "merge_late": (-40.5, 49.5),
    }


def test_with_somebody_beside_it_is_they_who_are_ahead_or_after():
    assert gaps(track(104.0), track(160.0), track(40.0)) == {
        "merge_early": (49.5, -14.5),
        "merge_late": (-6.5, 49.5),
    }


def test_who_is_far_behind_leaves_the_lane_free():
    behind = 100.0 - 10.5 - GapSettings().clear_behind_m
    assert set(gaps(track(behind - 1.0))) == {"change_lane"}
    assert set(gaps(track(behind + 1.0))) == {"merge_early", "merge_late"}


@pytest.mark.parametrize("doubt", [{"age": 14}, {"state": TrackState.TENTATIVE}])
def test_a_gap_with_a_bound_not_known_well_enough_is_not_offered_and_not_taken_for_free(doubt):
    assert gaps(track(70.0, **doubt)) == {}
    assert set(gaps(track(70.0), track(160.0, **doubt))) == {"merge_late"}


@given(st.lists(st.floats(0.0, 200.0), max_size=5))
def test_a_gap_is_bounded_by_neighbours_in_order(positions):
    for name, gap in FINDER.find_gaps([track(x_m) for x_m in positions], TRUCK).items():
        if gap.ahead is not None and gap.behind is not None:
            between = gap.ahead.gap_m + gap.behind.gap_m + TRUCK.length_m
            assert between >= -5.0 - 1e-9, name  # two cars may overlap in a made-up lane
    beside = FINDER.find_beside([track(x_m) for x_m in positions], TRUCK)
    assert beside.ahead is None or beside.ahead.gap_m > -10.5
    assert beside.behind is None or beside.behind.gap_m >= -10.5
