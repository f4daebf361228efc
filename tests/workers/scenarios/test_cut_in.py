"""The cut-in: its geometry, its script, its bounds."""

import itertools

import numpy as np
import pytest
from msgspec import structs

from eigenfail.errors import InvalidValue, UnknownName
from eigenfail.settings import read_settings
from eigenfail_workers.scenarios.cut_in import CutIn, minimum_jerk


def situation(**parameters):
    return CutIn()(read_settings(CutIn.Parameters, parameters, "scenario_parameters"), seed=0)


def gap(ego, actor):
    return actor.x_m - ego.x_m - (ego.length_m + actor.length_m) / 2


def test_the_change_begins_at_its_distance_from_a_truck_that_kept_its_speed():
    for distance_m in (53.0, 58.0, 63.0):
        now = situation(distance_m=distance_m)
        ego = structs.replace(now.ego, x_m=now.ego.speed_mps * now.change_begins_s)
        step = now.change_begins_s / now.mission.dt_s
        actor_x_m = now.actors[0].x_m + now.actors[0].speed_mps * now.change_begins_s
        assert gap(ego, structs.replace(now.actors[0], x_m=actor_x_m)) == pytest.approx(distance_m)
        assert now.move_actor(0, int(step), ego).y_m == pytest.approx(3.5)
        assert now.move_actor(0, int(step) + 5, ego).y_m < 3.5


@pytest.mark.parametrize("offset_m", [1.9, 2.1])
def test_the_car_starts_in_the_other_lane_and_stays_astride_the_marking(offset_m):
    now = situation(final_offset_m=offset_m)
    states = [now.move_actor(0, step, now.ego) for step in range(now.steps + 1)]
    assert states[0] == now.actors[0]
    assert gap(now.ego, states[0]) == pytest.approx(94.0)
    assert states[-1].y_m == pytest.approx(offset_m)
    assert states[-1].y_m - states[-1].width_m / 2 < 1.75 < states[-1].y_m + states[-1].width_m / 2
    assert states[-1].y_m < (now.ego.width_m + states[-1].width_m) / 2
    assert all(later.y_m <= earlier.y_m for earlier, later in itertools.pairwise(states))


def test_heading_and_speed_are_those_of_the_path():
    now = situation()
    dt = now.mission.dt_s
    for step in range(1, now.steps):
        before, here, after = (now.move_actor(0, step + k, now.ego) for k in (-1, 0, 1))
        dx, dy = (after.x_m - before.x_m) / (2 * dt), (after.y_m - before.y_m) / (2 * dt)
        assert here.speed_mps * np.cos(here.heading_rad) == pytest.approx(dx, abs=1e-6)
        assert here.speed_mps * np.sin(here.heading_rad) == pytest.approx(dy, abs=5e-3)


def test_minimum_jerk_rests_at_both_ends():
    assert minimum_jerk(0.0) == (0.0, 0.0)
    assert minimum_jerk(1.0) == (1.0, 0.0)
    assert minimum_jerk(0.5) == (0.5, 1.875)  # 30/16 by hand


@pytest.mark.parametrize("value", [51.9, 70.1, float("nan"), "far"])
def test_parameters_outside_their_bounds_are_refused_by_name(value):
    with pytest.raises(InvalidValue, match="distance_m"):
        situation(distance_m=value)


def test_unknown_parameters_are_refused_with_the_known_ones():
    with pytest.raises(UnknownName, match="distance_m"):
        situation(distance=58.0)
