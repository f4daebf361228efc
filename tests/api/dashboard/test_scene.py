"""The course of an episode as a table and a player, of whatever a simulator told."""

import msgspec
import numpy as np
import pytest

from eigenfail.presentation.figures import UNKNOWN
from eigenfail.values import Outcome, Scene
from eigenfail_api.dashboard.scene import make_scene_chart

STEPS = 4


def scene(perceived, controls):
    return Scene(
        dt_s=0.1,
        vehicles=np.arange(8.0 * (STEPS + 1)).reshape(STEPS + 1, 2, 4).astype(np.float32),
        sizes=np.full((2, 2), 2.0, np.float32),
        perceived=np.ones((perceived, 2), np.float32),
        controls=np.ones((controls, 2), np.float32),
    )


@pytest.mark.parametrize(("perceived", "controls"), [(4, 4), (2, 4), (4, 2), (0, 0), (2, 3)])
def test_steps_of_which_nothing_was_perceived_or_done_are_shown(perceived, controls):
    chart = make_scene_chart(scene(perceived, controls), None, Outcome.COLLISION)
    known = [row[6] != UNKNOWN for row in chart.rows]
    told = min(perceived, controls)
    assert known == [True] * told + [False] * (STEPS + 1 - told)


def test_the_borders_of_the_lanes_and_the_kinds_are_drawn_where_they_are_told():
    told = scene(STEPS, STEPS)
    plain = make_scene_chart(told, None, Outcome.SAFE)
    assert plain.data.keys().isdisjoint({"road", "kinds"})
    border = np.array([[0.0, 2.0], [30.25, 2.0], [60.0, 9.5]], np.float32)
    shown = msgspec.structs.replace(told, road=(border,), kinds=("unknown", "pedestrian"))
    chart = make_scene_chart(shown, None, Outcome.SAFE)
    assert chart.data == plain.data | {"road": [border.tolist()], "kinds": ["", "pedestrian"]}


def test_a_vehicle_that_is_not_there_has_no_position_and_is_not_the_nearest():
    told = scene(STEPS, STEPS)
    vehicles = np.concatenate([told.vehicles, told.vehicles[:, 1:] + 50.0], axis=1)
    vehicles[2:, 1] = np.nan
    sizes = np.full((3, 2), 2.0, np.float32)
    comes_and_goes = msgspec.structs.replace(told, vehicles=vehicles, sizes=sizes)
    chart = make_scene_chart(comes_and_goes, None, Outcome.SAFE)
    assert chart.data["nearest"] == [1, 1, 2, 2, 2]
    assert np.isnan(chart.data["vehicles"][2][1]).all()  # null in JSON
    assert None not in chart.data["apart"]
    assert UNKNOWN not in {row[4] for row in chart.rows}
