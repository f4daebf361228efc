"""The merge: where everybody starts, and that nobody reacts."""

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eigenfail.settings import read_settings
from eigenfail_workers.scenarios.merge_in import MergeIn, MergeInParameters


def situation(**parameters):
    return MergeIn()(read_settings(MergeInParameters, parameters, "scenario_parameters"), seed=0)


def bounds():
    (schema,) = msgspec.json.schema(MergeInParameters)["$defs"].values()
    return {name: (f["minimum"], f["maximum"]) for name, f in schema["properties"].items()}


anywhere = st.fixed_dictionaries({name: st.floats(*ends) for name, ends in bounds().items()})


@given(anywhere)
def test_the_gap_lies_where_the_parameters_say_and_nobody_touches(parameters):
    now = situation(**parameters)
    first, second = now.actors
    gap_m = first.x_m - second.x_m - first.length_m
    assert gap_m == pytest.approx(parameters["gap_s"] * parameters["traffic_speed_mps"])
    rear_x_m = now.ego.x_m - now.ego.length_m / 2
    assert rear_x_m - (second.x_m + second.length_m / 2) == pytest.approx(parameters["behind_m"])
    front_x_m = now.ego.x_m + now.ego.length_m / 2
    assert now.mission.lane_0_ends_x_m - front_x_m == pytest.approx(parameters["ramp_m"])
    assert now.ego.y_m == 0.0
    assert {car.y_m for car in now.actors} == {now.mission.lane_width_m}


def test_the_cars_keep_speed_and_lane_whatever_the_truck_does():
    now = situation()
    beside = msgspec.structs.replace(now.actors[1], x_m=now.actors[1].x_m + 5.0)
    for actor, start in enumerate(now.actors):
        moved = now.move_actor(actor, 100, beside)
        assert moved.x_m == pytest.approx(start.x_m + 10.0 * start.speed_mps)
        assert msgspec.structs.replace(moved, x_m=start.x_m) == start
