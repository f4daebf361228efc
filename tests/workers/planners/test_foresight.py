"""What a driver foresees, against closed forms."""

import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec import structs

from eigenfail.values.scene import VehicleState
from eigenfail_workers.planners.idm import least_gap_behind

EGO = VehicleState(0.0, 0.0, 0.0, 20.0, 16.0, 2.5)
CAR = VehicleState(0.0, 3.5, 0.0, 20.0, 5.0, 2.0)

speeds = st.floats(15.0, 25.0)
gaps = st.floats(0.0, 60.0)


def behind(gap, speed_mps=20.0):
    return structs.replace(CAR, x_m=-10.5 - gap, speed_mps=speed_mps)


def ahead(gap, speed_mps=20.0):
    return structs.replace(CAR, x_m=10.5 + gap, speed_mps=speed_mps)


@given(gaps, speeds)
def test_who_keeps_its_speed_is_caught_up_by_the_difference(gap, follower_mps):
    least = least_gap_behind(EGO, None, behind(gap, follower_mps), lambda *_: 0.0, 10.0)
    assert least == pytest.approx(gap - 10.0 * max(follower_mps - 20.0, 0.0))


def test_who_gains_speed_is_nearest_when_both_are_as_fast():
    """20 m/s and 1 m/s² against 22: after two seconds; 22 · 2 - (20.5 + 21 + 21.5 + 22) / 2."""
    least = least_gap_behind(EGO, None, behind(10.0, 22.0), lambda *_: 1.0, 10.0)
    assert least == pytest.approx(10.0 - (44.0 - 42.5))


def test_a_lead_is_followed_by_the_model_at_the_gap_there_will_be():
    seen = []
    slower = ahead(30.0, speed_mps=18.0)
    least_gap_behind(EGO, slower, behind(5.0), lambda *at: float(seen.append(at) or 0.0), 2.0)
    assert seen == [(20.0, 30.0, 18.0), (20.0, 29.0, 18.0), (20.0, 28.0, 18.0), (20.0, 27.0, 18.0)]


@given(speeds, st.floats(10.0, 60.0), speeds, gaps, speeds)
def test_more_room_behind_is_as_much_more_at_the_nearest(lead, room, own, gap, follower):
    ego = structs.replace(EGO, speed_mps=own)

    def model(speed_mps, room_m, _pace_mps):
        wanted = 2.0 + 1.5 * speed_mps
        return 0.8 * (1.0 - (speed_mps / 24.0) ** 4 - (wanted / max(room_m, 0.1)) ** 2)

    near, far = (
        least_gap_behind(ego, ahead(room, lead), behind(g, follower), model, 20.0)
        for g in (gap, gap + 1.0)
    )
    assert far - near == pytest.approx(1.0)
    assert near <= gap + 1e-9
