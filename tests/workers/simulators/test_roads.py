"""The roads of highway-env that the missions ask for."""

import numpy as np
import pytest
from msgspec import structs

from eigenfail.values import Mission
from eigenfail_workers.simulators.highway import straight_lanes

MISSION = Mission(0.1, 2, 3.5, 25.0, 24.0, 1000.0)
RAMP = structs.replace(MISSION, lane_0_ends_x_m=300.0)


def lanes_at(mission, x_m, y_m):
    """The lanes of highway-env on which a vehicle there would be; it adds 5 m at their ends."""
    every = straight_lanes(mission).lanes_list()
    return [lane for lane in every if lane.on_lane(np.array((x_m, y_m)))]


@pytest.mark.parametrize("lane", [0, 1])
def test_without_an_end_every_lane_goes_on(lane):
    for x_m in (-500.0, 0.0, 299.0, 301.0, 5000.0):
        (found,) = lanes_at(MISSION, x_m, lane * 3.5)
        assert found.speed_limit == 25.0
    assert len(straight_lanes(MISSION).lanes_list()) == 2


def test_lane_0_ends_where_the_mission_says_and_the_other_goes_on():
    assert len(lanes_at(RAMP, 299.0, 0.0)) == 1
    assert lanes_at(RAMP, 306.0, 0.0) == []
    assert len(lanes_at(RAMP, 290.0, 3.5)) == 1
    assert lanes_at(RAMP, 5000.0, 3.5) != []


def test_the_section_after_the_end_follows_from_the_one_before():
    network = straight_lanes(RAMP)
    begin, middle = network.get_closest_lane_index(np.array((0.0, 3.5)))[:2]
    again, _ = network.get_closest_lane_index(np.array((400.0, 3.5)))[:2]
    assert begin != middle
    assert again == middle
