"""The course of an episode as a table and a player, of whatever a simulator told."""

import msgspec
import numpy as np
import pytest
from tests.support.chart_tables import read_data, read_headings, read_rows

from eigenfail.presentation.figures import UNKNOWN
from eigenfail.values.disturbance import NoiseTrajectory
from eigenfail.values.episode import Outcome
from eigenfail.values.scene import Scene
from eigenfail_api.dashboard.scene import (
    make_course_charts,
    make_noise_chart,
    make_scene_chart,
)

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
    known = [row[6] != UNKNOWN for row in read_rows(chart.table)]
    told = min(perceived, controls)
    assert known == [True] * told + [False] * (STEPS + 1 - told)


def test_the_borders_of_the_lanes_and_the_kinds_are_drawn_where_they_are_told():
    told = scene(STEPS, STEPS)
    plain = make_scene_chart(told, None, Outcome.SAFE)
    assert plain.data.keys().isdisjoint({"road", "kinds"})
    border = np.array([[0.0, 2.0], [30.25, 2.0], [60.0, 9.5]], np.float32)
    shown = msgspec.structs.replace(told, road=(border,), kinds=("unknown", "pedestrian"))
    chart = make_scene_chart(shown, None, Outcome.SAFE)
    more = {"road": [border.tolist()], "kinds": ["", "pedestrian"]}
    assert read_data(chart) == read_data(plain) | more


def drive(accelerations, speeds):
    """A truck with these controls and speeds, far behind a car that stands beside the road."""
    steps = len(speeds)
    vehicles = np.zeros((steps, 2, 4), np.float32)
    vehicles[:, 0, 3] = speeds
    vehicles[:, 1, 1] = 30.0
    controls = np.stack([accelerations, np.zeros(steps - 1)], axis=1).astype(np.float32)
    sizes = np.full((2, 2), 2.0, np.float32)
    return Scene(0.1, vehicles, sizes, np.ones((steps - 1, 2), np.float32), controls)


def test_a_strip_of_a_quantity_that_hardly_changes_is_not_blown_up():
    charts = make_course_charts(drive([1e-5, 0.0, -1e-6], [0.0, 0.0, 0.0, 0.0]))
    ticks = {chart.id: chart.data["ticks"] for chart in charts}
    assert ticks["acceleration-chart"] == (-1.0, 1.0, 1.0)
    assert ticks["speed-chart"] == (0.0, 6.0, 2.0)
    assert ticks["ttc-chart"] == (0.0, 3.0, 1.0)
    assert ticks["clearance-chart"] == (0.0, 30.0, 10.0)


def test_a_strip_holds_all_values_of_a_drive_between_round_ticks():
    charts = make_course_charts(drive([2.3, -7.0, -7.0], [24.2, 22.0, 15.3, 8.1]))
    for chart in charts:
        low, high, step = chart.data["ticks"]
        known = [value for value in read_data(chart)["values"] if value is not None]
        assert all(low <= value <= high for value in known)
        assert (high - low) / step == pytest.approx(round((high - low) / step))
        assert 1 <= (high - low) / step <= 5


def test_of_many_channels_the_strongest_come_first_and_the_others_on_demand():
    z = np.zeros((4, 7), np.float32)
    z[:, 5], z[:, 2], z[:, 6] = 3.0, 2.0, 1.0
    names = [f"vehicle_{number}.lateral" for number in range(1, 8)]
    chart = make_noise_chart(NoiseTrajectory(z, np.ones_like(z)), 0.1, names)
    assert [*chart.data["channels"]][:3] == [names[5], names[2], names[6]]
    assert {*chart.data["channels"]} == {*names}
    assert (chart.channels, chart.first_channel_count) == (7, 3)
    assert len(read_headings(chart.table)) == len(read_rows(chart.table)[0]) == 2 + 2 * 3
    assert len(read_headings(chart.every)) == 2 + 2 * 7
    assert {len(row) for row in read_rows(chart.every)} == {2 + 2 * 7}
    few = make_noise_chart(NoiseTrajectory(z[:, :3], np.ones_like(z[:, :3])), 0.1, names[:3])
    assert [*few.data["channels"]] == names[:3]
    assert few.every is None


def test_a_vehicle_that_is_not_there_has_no_position_and_is_not_the_nearest():
    told = scene(STEPS, STEPS)
    vehicles = np.concatenate([told.vehicles, told.vehicles[:, 1:] + 50.0], axis=1)
    vehicles[2:, 1] = np.nan
    sizes = np.full((3, 2), 2.0, np.float32)
    comes_and_goes = msgspec.structs.replace(told, vehicles=vehicles, sizes=sizes)
    chart = make_scene_chart(comes_and_goes, None, Outcome.SAFE)
    assert chart.data["nearest"] == [1, 1, 2, 2, 2]
    data = read_data(chart)
    assert data["vehicles"][2][1] == [None] * 4
    assert None not in data["apart"]
    assert UNKNOWN not in {row[4] for row in read_rows(chart.table)}
