"""TTC and DRAC, worked out by hand."""

from itertools import pairwise
from math import copysign, cos, hypot, pi, sin

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from msgspec import structs

from eigenfail.errors import SimulatorError
from eigenfail.values.scene import VehicleState
from eigenfail_workers.measures.encounters import (
    HIDDEN_M,
    Pair,
    TrafficSample,
    find_conflict,
    find_contact,
    find_pass,
    may_touch,
    move,
    shares_path,
)
from eigenfail_workers.measures.geometry import separation
from eigenfail_workers.values import TrafficConflict

TRUCK = VehicleState(0.0, 0.0, 0.0, 24.0, 16.0, 2.5)
LEFT, RIGHT = pi / 2, -pi / 2


def square(x: float, y: float, heading: float, speed: float) -> VehicleState:
    """2 m × 2 m: its extents are the same at every right angle."""
    return VehicleState(x, y, heading, speed, 2.0, 2.0)


def of(ego: VehicleState, other: VehicleState) -> TrafficConflict | None:
    return find_conflict(ego, other, separation(ego, other))


def numbers(ego: VehicleState, other: VehicleState) -> tuple[float, float]:
    """TTC and DRAC of a conflict."""
    found = of(ego, other)
    assert found is not None
    return found.ttc_s, found.drac_mps2


def test_behind_a_slower_vehicle_in_the_lane() -> None:
    # gap 60.5 - 8 - 2.5 = 50 m, closing at 12 m/s
    found = numbers(TRUCK, VehicleState(60.5, 0.0, 0.0, 12.0, 5.0, 2.0))
    assert found == pytest.approx((50.0 / 12.0, 144.0 / 100.0))


def test_before_a_faster_vehicle_in_the_lane() -> None:
    # gap 30 - 8 - 1 = 21 m, closing at 6 m/s
    assert numbers(TRUCK, square(-30.0, 0.0, 0.0, 30.0)) == pytest.approx((3.5, 36.0 / 42.0))


def test_beside_a_vehicle_that_comes_over() -> None:
    # gap 3.5 - 1.25 - 1 = 1.25 m across, closing at 1.25 m/s: it is there in just 1 s
    found = numbers(TRUCK, square(0.0, 3.5, RIGHT, 1.25))
    assert found == pytest.approx((1.0, 1.25**2 / 2.5))


def test_from_corner_to_corner() -> None:
    # gaps 4 m along and 3 m across: 5 m; (24, 3) on (0.8, 0.6) closes at 21 m/s
    found = numbers(TRUCK, square(8.0 + 1.0 + 4.0, 1.25 + 1.0 + 3.0, RIGHT, 3.0))
    assert found == pytest.approx((5.0 / 21.0, 21.0**2 / 10.0))


@pytest.mark.parametrize(
    "other",
    [
        pytest.param(square(40.0, 0.0, 0.0, 24.0), id="as fast"),
        pytest.param(square(40.0, 0.0, 0.0, 30.0), id="faster ahead"),
        pytest.param(square(-40.0, 0.0, 0.0, 10.0), id="slower behind"),
        pytest.param(square(40.0, 3.5, 0.0, 0.0), id="stays in the next lane"),
        pytest.param(square(40.0, 3.5, LEFT, 2.0), id="leaves"),
        pytest.param(square(40.0, 3.5, RIGHT, 1.24), id="comes over too slowly"),
        pytest.param(square(40.0, -3.5, LEFT, 1.24), id="comes over too slowly from the right"),
        pytest.param(square(8.5, 0.0, 0.0, 0.0), id="touches"),
    ],
)
def test_no_conflict(other: VehicleState) -> None:
    assert of(TRUCK, other) is None


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_the_ego_may_be_the_one_who_comes_over(side: float) -> None:
    merging = VehicleState(0.0, 0.0, side * 0.1, 24.0, 16.0, 2.5)
    assert shares_path(merging, square(40.0, side * 3.5, 0.0, 10.0))
    assert not shares_path(merging, square(40.0, -side * 5.5, 0.0, 10.0))


@settings(deadline=None, derandomize=True, max_examples=100)
@given(st.floats(0.1, 100.0), st.floats(0.1, 20.0))
def test_braking_by_drac_stops_just_before_contact(gap_m: float, closing_mps: float) -> None:
    other = square(9.0 + gap_m, 0.0, 0.0, 24.0 - closing_mps)
    found = of(TRUCK, other)
    assert found is not None
    time_s = closing_mps / found.drac_mps2
    way_m = closing_mps * time_s - 0.5 * found.drac_mps2 * time_s**2
    assert way_m == pytest.approx(gap_m, rel=1e-6)
    assert found.ttc_s * closing_mps == pytest.approx(gap_m, rel=1e-6)


near = st.floats(-40.0, 40.0)
speed = st.floats(0.0, 40.0)
heading = st.floats(-0.5, 0.5)
vehicles = st.builds(
    VehicleState, near, near, heading, speed, st.floats(1.0, 20.0), st.floats(0.5, 3.0)
)
many = settings(deadline=None, derandomize=True, max_examples=200)


def close(found: TrafficConflict | None, wanted: TrafficConflict | None) -> bool:
    """The same, but for rounding; which may also hide a conflict that hardly closes."""
    if found is None or wanted is None:
        other = found or wanted
        return other is None or other.ttc_s > 1e6
    return structs.astuple(found) == pytest.approx(structs.astuple(wanted), rel=1e-6)


def clear(a: VehicleState, b: VehicleState) -> bool:
    """Not within a rounding error of touching, or of a path that is not shared."""
    wider = structs.replace(a, width_m=a.width_m + 1e-9)
    apart = separation(a, b).distance_m
    return (apart == 0.0 or apart > 1e-3) and shares_path(a, b) == shares_path(wider, b)


@many
@given(vehicles, vehicles)
def test_is_the_same_from_the_others_side(a: VehicleState, b: VehicleState) -> None:
    if clear(a, b):
        assert close(of(a, b), of(b, a))


@many
@given(vehicles, vehicles, near, near)
def test_survives_being_moved(a: VehicleState, b: VehicleState, dx: float, dy: float) -> None:
    def moved(v: VehicleState) -> VehicleState:
        return structs.replace(v, x_m=v.x_m + dx, y_m=v.y_m + dy)

    if clear(a, b):
        assert close(of(moved(a), moved(b)), of(a, b))


@many
@given(vehicles, vehicles)
def test_survives_being_mirrored_across_the_road(a: VehicleState, b: VehicleState) -> None:
    def mirrored(v: VehicleState) -> VehicleState:
        return structs.replace(v, y_m=-v.y_m, heading_rad=-v.heading_rad)

    if clear(a, b):
        assert close(of(mirrored(a), mirrored(b)), of(a, b))


place = st.floats(-40.0, 40.0)
size = st.tuples(st.floats(0.5, 18.0), st.floats(0.5, 3.0))


@st.composite
def steps(draw: st.DrawFn) -> tuple[Pair, Pair]:
    """Two vehicles before and after a step, of any way and a turn of up to 0.3 rad."""
    pairs = []
    for _ in range(2):
        length_m, width_m = draw(size)
        heading = draw(st.floats(-pi, pi))
        turn = draw(st.one_of(st.just(0.0), st.floats(-0.3, 0.3)))
        here, there = (draw(place), draw(place)), (draw(place), draw(place))
        speeds = draw(st.floats(0.0, 40.0)), draw(st.floats(0.0, 40.0))
        pairs.append(
            (
                VehicleState(here[0], here[1], heading, speeds[0], length_m, width_m),
                VehicleState(there[0], there[1], heading + turn, speeds[1], length_m, width_m),
            )
        )
    (ego, ego_after), (other, other_after) = pairs
    return Pair(ego, other), Pair(ego_after, other_after)


def passed(before: Pair, after: Pair) -> float:
    """Smallest distance within a step and at its ends. [m]"""
    ends = separation(before.ego, before.other), separation(after.ego, after.other)
    found = find_pass(before, after, ends[0], ends[1])
    least_m = min(ends[0].distance_m, ends[1].distance_m)
    return least_m if found is None else found.distance_m


def sampled(before: Pair, after: Pair, samples: int = 400) -> float:
    """The same, from many samples within the step. [m]"""
    distances = []
    for k in range(samples + 1):
        ego = move(before.ego, after.ego, k / samples)
        distances.append(separation(ego, move(before.other, after.other, k / samples)).distance_m)
    return min(distances)


@settings(deadline=None, derandomize=True, max_examples=300)
@given(steps())
def test_pass_is_the_smallest_of_many_samples(step: tuple[Pair, Pair]) -> None:
    before, after = step
    found, dense = passed(before, after), sampled(before, after)
    ends = separation(before.ego, before.other), separation(after.ego, after.other)
    assert found <= min(ends[0].distance_m, ends[1].distance_m)
    assert found <= dense + HIDDEN_M + 1e-6
    # Between two of the 400 samples a corner moves by 0.6 m at most.
    assert found >= dense - 0.6
    samples = [TrafficSample(each.ego, (each.other,), (1,)) for each in step]
    assert found > 0.0 or may_touch(*samples), "the quick test rules out a contact"


@settings(deadline=None, derandomize=True, max_examples=100)
@given(steps())
def test_pass_is_symmetric(step: tuple[Pair, Pair]) -> None:
    before, after = step
    exchanged = passed(Pair(before.other, before.ego), Pair(after.other, after.ego))
    backwards = passed(after, before)
    assert exchanged == pytest.approx(passed(before, after), abs=2 * HIDDEN_M)
    assert backwards == pytest.approx(passed(before, after), abs=2 * HIDDEN_M)


def square_pair(ego_x: float, other_x: float, other_y: float) -> Pair:
    return Pair(square(ego_x, 0.0, 0.0, 20.0), square(other_x, other_y, pi, 20.0))


def test_pass_within_a_step_is_worked_out_by_hand() -> None:
    # 2 m squares, 3 m apart across: 1 m between them when they are side by side
    before, after = square_pair(0.0, 20.0, 3.0), square_pair(10.0, 2.0, 3.0)
    apart = separation(before.ego, before.other), separation(after.ego, after.other)
    found = find_pass(before, after, apart[0], apart[1])
    assert found is not None
    assert found.distance_m == pytest.approx(1.0)
    # They are side by side while their centres are less than 2 m apart along: 18 … 22 of 28 m.
    assert 18.0 / 28.0 <= found.share <= 22.0 / 28.0
    assert find_pass(before, before, apart[0], apart[0]) is None


def test_contact_within_a_step_is_the_first_one() -> None:
    near, far = square(12.0, 0.0, 0.0, 0.0), square(18.0, 0.0, 0.0, 0.0)
    ego, later = square(0.0, 0.0, 0.0, 40.0), square(40.0, 0.0, 0.0, 40.0)
    before, after = (
        TrafficSample(ego, (far, near), (1, 2)),
        TrafficSample(later, (far, near), (1, 2)),
    )
    contact = find_contact(before, after, 1.0)
    assert contact is not None
    assert contact.ego.x_m == pytest.approx(10.0, abs=1e-6)
    assert separation(contact.ego, near).distance_m == 0.0
    # A truck that the sample shows is touched after the first car, and before the second one.
    truck = VehicleState(30.0, 1.5, 0.0, 0.0, 30.0, 2.0)
    pair = [TrafficSample(each, (far, near, truck), (1, 2, 3)) for each in (ego, later)]
    assert find_contact(*pair, 1.0).ego.x_m == pytest.approx(10.0, abs=1e-6)
    # The sample shows the second car that the ego touches, and hides the first one.
    behind = TrafficSample(square(18.0, 0.0, 0.0, 40.0), (far, near), (1, 2))
    hidden = find_contact(before, behind, 1.0)
    assert hidden is not None
    assert hidden.ego.x_m == pytest.approx(10.0, abs=1e-6)
    # It shows the first one: that sample is the collision.
    assert (
        find_contact(before, TrafficSample(square(11.0, 0.0, 0.0, 40.0), (far, near), (1, 2)), 1.0)
        is None
    )


def test_heading_that_is_turned_round_turns_no_footprint() -> None:
    """A tracker's mistake: a long vehicle in the next lane that seems to turn within a step."""
    truck = VehicleState(0.0, 0.0, 0.0, 10.0, 16.0, 2.5)
    beside = VehicleState(0.0, 3.5, 0.0, 10.0, 16.0, 2.5)
    before, after = Pair(truck, beside), Pair(truck, structs.replace(beside, heading_rad=pi))
    assert passed(before, after) == pytest.approx(1.0)
    assert move(beside, after.other, 0.75).heading_rad == pytest.approx(pi)


def test_jump_across_the_ego_is_refused() -> None:
    before = TrafficSample(TRUCK, (square(60.0, 0.0, 0.0, 20.0),), (1,))
    after = TrafficSample(TRUCK, (square(-60.0, 0.0, 0.0, 20.0),), (1,))
    with pytest.raises(SimulatorError, match="Vehicle 1 jumps across the ego: 120 m"):
        find_contact(before, after, 0.1)


def test_vehicle_that_vanishes_where_the_ego_stands_at_the_sample_is_refused() -> None:
    before = TrafficSample(square(0.0, 0.0, 0.0, 20.0), (square(3.0, 0.0, 0.0, 0.0),), (1,))
    with pytest.raises(SimulatorError, match="Vehicle 1 vanishes"):
        find_contact(before, TrafficSample(square(2.0, 0.0, 0.0, 20.0), (), ()), 0.1)


def test_vehicle_without_both_ends_is_not_moved() -> None:
    before = TrafficSample(TRUCK, (square(60.0, 0.0, 0.0, 20.0),), (1,))
    after = TrafficSample(TRUCK, (square(-60.0, 0.0, 0.0, 20.0),), (2,))
    assert find_contact(before, after, 0.1) is None


def drive_arc(radius_m: float, at_rad: float, speed_mps: float = 10.0) -> VehicleState:
    """A car on a circle about the origin that turns left; to the right if the radius is negative.

    In reverse, at a negative speed, it drives the same circle the other way round.
    """
    return VehicleState(
        radius_m * sin(at_rad), -radius_m * cos(at_rad), at_rad, speed_mps, 4.5, 2.0
    )


@pytest.mark.parametrize("radius_m", [12.0, -12.0, 30.0])
@pytest.mark.parametrize("speed_mps", [10.0, -10.0])
@pytest.mark.parametrize("dt_s", [0.2, 0.5, 1.0])
def test_way_within_a_step_is_an_arc(radius_m: float, speed_mps: float, dt_s: float) -> None:
    turn = speed_mps * dt_s / radius_m
    before = drive_arc(radius_m, 0.3, speed_mps)
    after = drive_arc(radius_m, 0.3 + turn, speed_mps)
    for share in (0.0, 0.25, 0.5, 0.75, 1.0):
        found = move(before, after, share)
        wanted = drive_arc(radius_m, 0.3 + share * turn, speed_mps)
        assert hypot(found.x_m - wanted.x_m, found.y_m - wanted.y_m) < 0.06 * dt_s


@pytest.mark.parametrize("dt_s", [0.1, 0.2, 0.25, 0.5, 1.0])
@pytest.mark.parametrize("radius_m", [12.0, -12.0])
@pytest.mark.parametrize("is_inside", [True, False])
def test_a_post_beside_an_arc_is_judged_alike_at_any_step(
    dt_s: float, radius_m: float, is_inside: bool
) -> None:
    """The car's side sweeps 11 m to its centre, a front corner 13.2 m."""
    reach_m = abs(radius_m) - 1.0 if is_inside else hypot(abs(radius_m) + 1.0, 2.25)
    for clear_m in (0.15, -0.15):
        at_m = reach_m - clear_m if is_inside else reach_m + clear_m
        touched = False
        for phase in range(8):
            angle = copysign(0.6 + 0.05 * phase, radius_m)
            post_x, post_y = at_m * sin(abs(angle)), -copysign(at_m, radius_m) * cos(angle)
            post = VehicleState(post_x, post_y, angle, 0.0, 0.02, 0.02)
            steps_rad = [10.0 * dt_s * step / radius_m for step in range(round(2.0 / dt_s))]
            states = [drive_arc(radius_m, at_rad) for at_rad in steps_rad]
            touched |= any(separation(state, post).distance_m == 0.0 for state in states)
            touched |= any(
                find_contact(
                    TrafficSample(early, (post,), (1,)), TrafficSample(late, (post,), (1,)), dt_s
                )
                is not None
                for early, late in pairwise(states)
            )
        assert touched == (clear_m < 0.0)


def test_heading_that_no_tyre_could_turn_bends_no_way() -> None:
    """A tracker's headings jump by 0.4 rad at 30 m/s: the car drives on along its lane."""
    before = VehicleState(0.0, 0.0, 0.2, 30.0, 4.5, 2.0)
    after = VehicleState(15.0, 0.0, -0.2, 30.0, 4.5, 2.0)
    assert move(before, after, 0.5).y_m == 0.0
    slower = structs.replace(before, speed_mps=5.0), structs.replace(after, x_m=2.5, speed_mps=5.0)
    assert move(*slower, 0.5).y_m == pytest.approx(2.5 * 0.4 / 8)
