"""Where the road ends."""

import msgspec
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eigenfail.values.scene import Mission, VehicleState
from eigenfail_workers.motion import is_off_road

TWO_LANES = Mission(0.1, 2, 3.5, 25.0, 24.0, 1000.0)
RAMP = msgspec.structs.replace(TWO_LANES, lane_0_ends_x_m=200.0)
any_x, any_y = st.floats(-1e3, 1e3), st.floats(-20.0, 20.0)
many = settings(deadline=None, derandomize=True, max_examples=200)


def truck(x: float, y: float) -> VehicleState:
    return VehicleState(x, y, 0.0, 20.0, 16.0, 2.5)


@pytest.mark.parametrize(
    ("mission", "x", "y", "off"),
    [
        (TWO_LANES, 0.0, 0.0, False),
        (TWO_LANES, 0.0, -1.75, False),
        (TWO_LANES, 0.0, -1.76, True),
        (TWO_LANES, 0.0, 5.25, False),
        (TWO_LANES, 0.0, 5.26, True),
        (TWO_LANES, 900.0, 0.0, False),
        (RAMP, 200.0, 0.0, False),
        (RAMP, 200.1, 0.0, True),
        # its front alone is beyond the end: the truck can still merge
        (RAMP, 195.0, 0.0, False),
        (RAMP, 200.1, 1.74, True),
        (RAMP, 200.1, 1.75, False),
        (RAMP, 300.0, 3.5, False),
        (RAMP, 300.0, 5.3, True),
    ],
)
def test_edges_and_ends(mission: Mission, x: float, y: float, off: bool) -> None:
    assert is_off_road(mission, truck(x, y)) is off


@many
@given(any_x, any_y)
def test_an_end_takes_road_away_and_never_adds_any(x: float, y: float) -> None:
    assert is_off_road(RAMP, truck(x, y)) >= is_off_road(TWO_LANES, truck(x, y))


@many
@given(any_x, any_y, st.integers(1, 5))
def test_another_lane_never_takes_road_away(x: float, y: float, lanes: int) -> None:
    narrow, wide = (msgspec.structs.replace(RAMP, lanes=n) for n in (lanes, lanes + 1))
    assert is_off_road(wide, truck(x, y)) <= is_off_road(narrow, truck(x, y))


@many
@given(any_x, any_y)
def test_both_sides_of_a_road_are_alike(x: float, y: float) -> None:
    middle = 1.75
    mirrored = truck(x, 2.0 * middle - y)
    # Within a rounding error of the edge either may be said.
    if min(abs(y + 1.75), abs(y - 5.25)) > 1e-9:
        assert is_off_road(TWO_LANES, truck(x, y)) == is_off_road(TWO_LANES, mirrored)
