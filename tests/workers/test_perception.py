"""What a planner perceives under each channel, and what it does not."""

from math import isnan

import pytest
from msgspec.structs import asdict, replace

from eigenfail.values.channels import QUANTITIES, Channel
from eigenfail.values.scene import Observation, VehicleState
from eigenfail_workers.perception import LEAST_SIZE_M, SensorErrors

EGO = VehicleState(0.0, 0.0, 0.0, 24.0, 12.0, 2.5)
NEAR = VehicleState(30.0, 3.5, 0.0, 12.0, 5.0, 2.0)
FAR = VehicleState(-60.0, 0.0, 0.0, 20.0, 4.0, 1.8)
TRUTH = Observation(4, EGO, (FAR, NEAR))
FIELDS = {
    "longitudinal": "x_m",
    "lateral": "y_m",
    "heading": "heading_rad",
    "speed": "speed_mps",
    "length": "length_m",
    "width": "width_m",
}
TARGETS = {"": 1, "vehicle_1.": 0, "vehicle_2.": 1}


def perceive(*errors: tuple[str, float], truth: Observation = TRUTH):
    channels = tuple(Channel(name).filled() for name, _ in errors)
    values = tuple(error for _, error in errors)
    return SensorErrors(channels).perceive(truth, 0.1, values)


@pytest.mark.parametrize("target", TARGETS)
@pytest.mark.parametrize("quantity", FIELDS)
def test_an_error_is_added_to_its_quantity_of_its_vehicle_alone(target, quantity) -> None:
    seen, _ = perceive((f"{target}{quantity}", 0.25))
    place, field = TARGETS[target], FIELDS[quantity]
    expected = [asdict(FAR), asdict(NEAR)]
    expected[place][field] += 0.25
    assert [asdict(each) for each in seen.others] == expected
    assert (seen.ego, seen.ids, seen.time_s) == (EGO, (1, 2), 0.4)


@pytest.mark.parametrize("quantity", ["longitudinal", "lateral", "heading", "speed"])
def test_an_error_of_the_ego_is_added_to_the_ego_alone(quantity) -> None:
    seen, position = perceive((f"ego.{quantity}", -0.5))
    expected = asdict(EGO)
    expected[FIELDS[quantity]] -= 0.5
    assert asdict(seen.ego) == expected
    assert (seen.others, position) == ((FAR, NEAR), (30.0, 3.5))


def test_errors_of_one_vehicle_add_up() -> None:
    seen, position = perceive(("longitudinal", 1.0), ("vehicle_2.longitudinal", 0.5))
    assert position == (31.5, 3.5)
    assert seen.others[0] == FAR


def test_a_missed_vehicle_is_absent_and_the_others_keep_their_numbers() -> None:
    seen, position = perceive(("vehicle_1.missed", 1.0))
    assert (seen.others, seen.ids, position) == ((NEAR,), (2,), (30.0, 3.5))
    seen, position = perceive(("missed", 1.0), ("longitudinal", 2.0))
    assert (seen.others, seen.ids) == ((FAR,), (1,))
    assert all(map(isnan, position))
    seen, _ = perceive(("missed", 0.0))
    assert seen.ids == (1, 2)


LINE = Observation(4, EGO, (replace(NEAR, x_m=54.0, y_m=7.0), NEAR, FAR))
"""The first is on the line from the centre of the ego's front to the second."""


def test_a_vehicle_that_another_hides_is_absent() -> None:
    sensor = SensorErrors((Channel("longitudinal").filled(),), occlusion=True)
    seen, position = sensor.perceive(LINE, 0.1, (0.5,))
    assert (seen.ids, position) == ((2, 3), (30.5, 3.5))
    assert SensorErrors(()).perceive(LINE, 0.1, ())[0].ids == (1, 2, 3)


def test_a_vehicle_is_absent_if_it_is_missed_or_hidden() -> None:
    channels = (Channel("vehicle_1.missed").filled(), Channel("vehicle_3.missed").filled())
    sensor = SensorErrors(channels, occlusion=True)
    assert sensor.perceive(LINE, 0.1, (1.0, 1.0))[0].ids == (2,)
    assert sensor.perceive(LINE, 0.1, (0.0, 0.0))[0].ids == (2, 3)


def test_a_missed_vehicle_hides_others_all_the_same() -> None:
    sensor = SensorErrors((Channel("missed").filled(),), occlusion=True)
    seen, position = sensor.perceive(LINE, 0.1, (1.0,))
    assert seen.ids == (3,)
    assert all(map(isnan, position))


NEXT = VehicleState(20.0, -30.0, 0.0, 20.0, 5.0, 2.0)


def test_while_they_are_swapped_the_two_nearest_have_each_others_number() -> None:
    truth = Observation(4, EGO, (FAR, NEAR, NEXT))
    seen, position = perceive(("swapped", 1.0), truth=truth)
    assert (seen.others, seen.ids, position) == (truth.others, (1, 3, 2), (30.0, 3.5))
    assert perceive(("swapped", 0.0), truth=truth)[0].ids == (1, 2, 3)
    assert perceive(("swapped", 1.0))[0].ids == (2, 1)


def test_a_swapped_vehicle_may_be_missed_and_errors_stay_with_the_vehicle() -> None:
    truth = Observation(4, EGO, (FAR, NEAR, NEXT))
    seen, _ = perceive(("swapped", 1.0), ("missed", 1.0), truth=truth)
    assert (seen.others, seen.ids) == ((FAR, NEXT), (1, 2))
    seen, _ = perceive(("vehicle_2.longitudinal", 1.0), ("swapped", 1.0), ("ghost", 1.0))
    assert (seen.others[1].x_m, seen.ids) == (31.0, (2, 1, 3))


def test_no_vehicle_is_perceived_without_a_size() -> None:
    seen, _ = perceive(("length", -30.0), ("width", -30.0))
    assert (seen.others[1].length_m, seen.others[1].width_m) == (LEAST_SIZE_M, LEAST_SIZE_M)


def test_a_ghost_stands_where_it_was_first_seen_until_it_is_gone() -> None:
    errors = SensorErrors((Channel("ghost", ahead_m=25.0).filled(),))
    later = Observation(5, VehicleState(2.4, 0.0, 0.0, 24.0, 12.0, 2.5), (FAR, NEAR))
    first, _ = errors.perceive(TRUTH, 0.1, (1.0,))
    second, _ = errors.perceive(later, 0.1, (1.0,))
    assert first.others[2] == second.others[2] == VehicleState(25.0, 0.0, 0.0, 0.0, 5.0, 2.0)
    assert first.ids == second.ids == (1, 2, 3)
    gone, _ = errors.perceive(later, 0.1, (0.0,))
    assert gone.ids == (1, 2)
    again, _ = errors.perceive(later, 0.1, (1.0,))
    assert again.others[2].x_m == 27.4


def test_a_ghost_does_not_outlive_its_episode() -> None:
    errors = SensorErrors((Channel("ghost", ahead_m=25.0).filled(),))
    errors.perceive(TRUTH, 0.1, (1.0,))
    errors.reset()
    later = Observation(0, VehicleState(2.4, 0.0, 0.0, 24.0, 12.0, 2.5), (FAR, NEAR))
    seen, _ = errors.perceive(later, 0.1, (1.0,))
    assert seen.others[2].x_m == 27.4


def follow(*errors: tuple[str, float], steps: int = 6):
    """Return what is perceived of a vehicle that moves by a metre in each step."""
    channels = tuple(Channel(name).filled() for name, _ in errors)
    sensor = SensorErrors(channels)
    truths = [
        Observation(step, EGO, (FAR, replace(NEAR, x_m=30.0 + step))) for step in range(steps)
    ]
    values = tuple(error for _, error in errors)
    return [sensor.perceive(truth, 0.1, values) for truth in truths]


@pytest.mark.parametrize(("delay_s", "late"), [(0.0, 0), (0.04, 0), (0.22, 2), (-0.3, 3), (9.0, 5)])
def test_others_are_perceived_as_they_were_before(delay_s, late) -> None:
    seen = follow(("delay", delay_s))
    places = [perception.others[1].x_m for perception, _ in seen]
    assert places == [30.0 + max(step - late, 0) for step in range(6)]
    assert {perception.ego for perception, _ in seen} == {EGO}
    assert [position for _, position in seen] == [(x_m, 3.5) for x_m in places]


def test_errors_are_added_to_what_is_late() -> None:
    seen = follow(("longitudinal", 0.5), ("delay", 0.1))
    assert [perception.others[1].x_m for perception, _ in seen] == [
        30.5,
        *[29.5 + n for n in range(1, 6)],
    ]


def test_nothing_of_an_earlier_episode_is_perceived() -> None:
    sensor = SensorErrors((Channel("delay").filled(),))
    sensor.perceive(Observation(0, EGO, (FAR,)), 0.1, (1.0,))
    sensor.reset()
    seen, _ = sensor.perceive(Observation(0, EGO, (NEAR,)), 0.1, (1.0,))
    assert seen.others == (NEAR,)


def test_every_quantity_has_its_case_here() -> None:
    assert {*FIELDS, "missed", "ghost", "delay", "swapped"} == set(QUANTITIES)


LATER = replace(TRUTH, others=(NEAR, FAR), ids=(3, 1))
"""Of three vehicles, the second is not there."""


@pytest.mark.parametrize(
    ("channel", "expected"),
    [
        ("vehicle_1.longitudinal", (NEAR, replace(FAR, x_m=-59.0))),
        ("vehicle_2.longitudinal", (NEAR, FAR)),
        ("vehicle_3.longitudinal", (replace(NEAR, x_m=31.0), FAR)),
        ("longitudinal", (replace(NEAR, x_m=31.0), FAR)),
    ],
)
def test_where_vehicles_come_and_go_an_error_is_of_their_number(channel, expected) -> None:
    seen, _ = perceive((channel, 1.0), truth=LATER)
    assert (seen.others, seen.ids) == (expected, (3, 1))


def test_a_missed_vehicle_is_found_by_its_number() -> None:
    assert perceive(("vehicle_3.missed", 1.0), truth=LATER)[0].ids == (1,)
    assert perceive(("vehicle_2.missed", 1.0), truth=LATER)[0].ids == (3, 1)
    assert perceive(("swapped", 1.0), truth=LATER)[0].ids == (1, 3)


def test_a_ghost_has_the_number_after_all_vehicles_of_the_episode() -> None:
    sensor = SensorErrors((Channel("ghost").filled(),))
    sensor.reset(3)
    assert sensor.perceive(LATER, 0.1, (1.0,))[0].ids == (3, 1, 4)


def test_a_delayed_vehicle_is_seen_once_it_was_there() -> None:
    sensor = SensorErrors((Channel("delay").filled(),))
    sensor.reset(3)
    first = replace(LATER, others=(FAR,), ids=(1,))
    assert sensor.perceive(first, 0.1, (0.1,))[0].ids == (1,)
    assert sensor.perceive(LATER, 0.1, (0.1,))[0].ids == (1,)
    assert sensor.perceive(LATER, 0.1, (0.1,))[0].ids == (3, 1)
