"""Lane keeping brings a bicycle back to its lane."""

from math import atan, cos, sin, tan

import pytest
from msgspec import structs

from eigenfail_workers.planners.steering import MAX_STEERING_RAD, LaneKeeping


@pytest.mark.parametrize("offset_m", [-1.0, 0.5, 1.5])
@pytest.mark.parametrize("centre_m", [0.0, 3.5])
def test_it_returns_to_the_nearest_centre_and_stays(mission, truck, offset_m, centre_m):
    keeping = LaneKeeping(mission)
    ego = structs.replace(truck, y_m=centre_m + offset_m)
    for _ in range(100):
        slip = atan(tan(keeping(ego)) / 2)
        ego = structs.replace(
            ego,
            x_m=ego.x_m + ego.speed_mps * cos(ego.heading_rad + slip) * 0.1,
            y_m=ego.y_m + ego.speed_mps * sin(ego.heading_rad + slip) * 0.1,
            heading_rad=ego.heading_rad + ego.speed_mps * sin(slip) / (ego.length_m / 2) * 0.1,
        )
        assert abs(ego.y_m - centre_m) <= abs(offset_m) * 1.2
    assert ego.y_m == pytest.approx(centre_m, abs=0.05)


def test_in_the_middle_it_does_nothing_and_its_angle_is_bounded(mission, truck):
    assert LaneKeeping(mission)(truck) == 0.0
    assert LaneKeeping(mission)(structs.replace(truck, heading_rad=1.5)) == -MAX_STEERING_RAD
