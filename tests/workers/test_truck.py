"""What the truck can do: closed forms, and what clipping never does."""

from functools import partial
from math import inf, pi

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eigenfail.values.scene import PEAK_BRAKING_MPS2, Control
from eigenfail_workers.motion import clip_control, max_drive_mps2

clip = partial(clip_control, peak_braking_mps2=PEAK_BRAKING_MPS2)
anything = st.floats(allow_nan=False, allow_infinity=False)
speeds = st.floats(0.0, 40.0)
many = settings(deadline=None, derandomize=True, max_examples=200)


@pytest.mark.parametrize(
    ("speed_mps", "strongest_mps2"),
    [
        (0.0, 1.5),
        (5.0, 1.5),
        # 400 kW = 30 t · 1.5 m/s² · 8.89 m/s: here power begins to be the limit
        (400.0 / 45.0, 1.5),
        (400.0 / 30.0, 1.0),
        (25.0, 400.0 / 750.0),
    ],
)
def test_drive_is_limited_by_gears_and_then_by_power(
    speed_mps: float, strongest_mps2: float
) -> None:
    assert max_drive_mps2(speed_mps) == pytest.approx(strongest_mps2)
    applied = clip(Control(3.0, 0.0), speed_mps)
    assert applied.acceleration_mps2 == pytest.approx(strongest_mps2)


@pytest.mark.parametrize("speed_mps", [0.0, 10.0, 30.0])
def test_brakes_and_steering_do_not_depend_on_the_speed(speed_mps: float) -> None:
    assert clip(Control(-7.5, -2.0), speed_mps) == Control(-7.0, -pi / 4)
    assert clip(Control(-7.0, pi / 4), speed_mps) == Control(-7.0, pi / 4)
    assert clip(Control(-6.9, 2.0), speed_mps) == Control(-6.9, pi / 4)


def test_a_loaded_truck_brakes_as_hard_as_its_own_brakes_allow() -> None:
    assert clip_control(Control(-7.0, 0.0), 20.0, 3.2) == Control(-3.2, 0.0)
    assert clip_control(Control(-3.1, 0.0), 20.0, 3.2) == Control(-3.1, 0.0)


@many
@given(anything, anything, speeds)
def test_clipping_twice_is_clipping_once(asked: float, steering: float, speed: float) -> None:
    once = clip(Control(asked, steering), speed)
    assert clip(once, speed) == once
    assert -7.0 <= once.acceleration_mps2 <= 1.5


@many
@given(anything, anything, speeds)
def test_asking_for_more_never_gives_less(one: float, other: float, speed: float) -> None:
    less, more = sorted((one, other))
    applied = [clip(Control(asked, 0.0), speed) for asked in (less, more)]
    assert applied[0].acceleration_mps2 <= applied[1].acceleration_mps2


@many
@given(speeds, speeds)
def test_the_faster_the_weaker(one: float, other: float) -> None:
    slow, fast = sorted((one, other))
    assert max_drive_mps2(fast) <= max_drive_mps2(slow) < inf


@many
@given(st.floats(-7.0, 0.5), st.floats(-pi / 4, pi / 4), st.floats(0.0, 25.0))
def test_what_the_truck_can_do_is_left_alone(asked: float, steering: float, speed: float) -> None:
    assert clip(Control(asked, steering), speed) == Control(asked, steering)
