"""Recorded tracks: the same from each format, on one grid; what cannot be used is refused."""

import csv
from math import atan2, cos, hypot, pi, sin

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eigenfail.errors import InvalidValue
from eigenfail.exchange.tracks import USUAL_SIZE_M, RoadFrame, read_tracks

HEADER = ("id", "time_s", "x_m", "y_m")


def write(path, rows, header=HEADER):
    with path.open("w", newline="") as file:
        writer = csv.writer(file)
        writer.writerow(header)
        writer.writerows(rows)
    return path


def straight(name, times, start=(0.0, 0.0), velocity=(20.0, 1.0)):
    (x_m, y_m), (along, across) = start, velocity
    return [(name, t, x_m + along * t, y_m + across * t) for t in times]


TIMES = [0.0, 0.3, 0.5, 1.0]
EGO = straight("1", TIMES)
OTHER = straight("2", [-1.0, 0.25, 2.0], (30.0, 3.5), (15.0, 0.0))


def test_tracks_are_interpolated_to_steps(tmp_path):
    tracks = read_tracks(write(tmp_path / "a.csv", [*OTHER, *EGO]), "1")
    time_s = np.arange(11) * 0.1
    assert (tracks.ids, tracks.dt_s, tracks.left_out) == (("1", "2"), 0.1, ())
    assert tracks.states.shape == (11, 2, 4)
    assert tracks.states[:, 0, 0] == pytest.approx(20.0 * time_s)
    assert tracks.states[:, 0, 1] == pytest.approx(time_s)
    assert tracks.states[:, 0, 2] == pytest.approx(atan2(1.0, 20.0))
    assert tracks.states[:, 0, 3] == pytest.approx(hypot(1.0, 20.0))
    assert tracks.states[:, 1, 0] == pytest.approx(30.0 + 15.0 * time_s)
    assert tuple(tracks.sizes[0]) == tuple(USUAL_SIZE_M.values())


def test_parquet_is_read_like_csv(tmp_path):
    from pyarrow import csv as arrow_csv
    from pyarrow import parquet

    path = write(tmp_path / "a.csv", [*EGO, *OTHER])
    parquet.write_table(arrow_csv.read_csv(path), tmp_path / "a.parquet")
    one, two = read_tracks(path, "1"), read_tracks(tmp_path / "a.parquet", "1")
    assert (one.ids, one.dt_s) == (two.ids, two.dt_s)
    assert np.array_equal(one.states, two.states)
    assert np.array_equal(one.sizes, two.sizes)


STATE = """<{tag}><position><point><x>{x}</x><y>{y}</y></point></position>
<orientation><exact>{heading}</exact></orientation><time><exact>{step}</exact></time>
<velocity><exact>{speed}</exact></velocity></{tag}>"""
OBSTACLE = """<dynamicObstacle id="{name}"><type>car</type>
<shape><rectangle><length>4.5</length><width>1.8</width></rectangle></shape>
{start}<trajectory>{states}</trajectory></dynamicObstacle>"""


def write_commonroad(path, *vehicles):
    """A file of vehicles at constant speed along x, each of id, x [m], y [m] and speed [m/s]."""
    obstacles = []
    for name, x_m, y_m, speed in vehicles:
        states = [
            STATE.format(tag=tag, x=x_m + speed * 0.1 * n, y=y_m, heading=0.0, step=n, speed=speed)
            for n, tag in enumerate(["initialState", *["state"] * 10])
        ]
        obstacles.append(OBSTACLE.format(name=name, start=states[0], states="".join(states[1:])))
    standing = '<dynamicObstacle id="9"><type>car</type></dynamicObstacle>'
    text = f'<commonRoad timeStepSize="0.1">{standing}{"".join(obstacles)}</commonRoad>'
    path.write_text(text)
    return path


def test_commonroad_is_read_like_csv(tmp_path):
    path = write_commonroad(tmp_path / "a.xml", ("1", 0.0, 0.0, 20.0), ("2", 30.0, 3.5, 15.0))
    tracks = read_tracks(path, "2")
    time_s = np.arange(11) * 0.1
    assert tracks.ids == ("2", "1")
    assert tracks.states[:, 0, 0] == pytest.approx(30.0 + 15.0 * time_s)
    assert tracks.states[:, 1, 3] == pytest.approx(20.0)
    assert tracks.sizes.tolist() == [[4.5, 1.8]] * 2


@pytest.mark.parametrize(
    ("text", "new", "words"),
    [
        ("<x>0.0</x>", "<x></x>", "could not convert"),
        ("<exact>0</exact>", "<intervalStart>0</intervalStart>", "no time/exact"),
        ("timeStepSize", "step", "timeStepSize"),
        ("</width>", "</width><originXShift>1.5</originXShift>", "no rectangle at its position"),
        ("</commonRoad>", "", "no element found|not CommonRoad"),
    ],
)
def test_commonroad_without_exact_states_is_refused(tmp_path, text, new, words):
    path = write_commonroad(tmp_path / "a.xml", ("1", 0.0, 0.0, 20.0), ("2", 30.0, 3.5, 15.0))
    path.write_text(path.read_text().replace(text, new))
    with pytest.raises(InvalidValue, match=words):
        read_tracks(path, "1")


@pytest.mark.parametrize(
    ("text", "new"),
    [("rectangle>", "circle>"), ("</width>", "</width><originXShift>1.5</originXShift>")],
)
def test_an_obstacle_of_another_shape_is_left_out_and_named(tmp_path, text, new):
    cars = ("1", 0.0, 0.0, 20.0), ("2", 30.0, 3.5, 15.0), ("3", 90.0, 0.0, 20.0)
    path = write_commonroad(tmp_path / "a.xml", *cars)
    before, last = path.read_text().split('<dynamicObstacle id="3">')
    path.write_text(before + '<dynamicObstacle id="3">' + last.replace(text, new))
    tracks = read_tracks(path, "1")
    assert (tracks.ids, tracks.left_out) == (("1", "2"), ("3",))
    with pytest.raises(InvalidValue, match="no rectangle") as refused:
        read_tracks(path, "3")
    assert refused.value.field == "ego"


@given(x_m=st.floats(-1e4, 1e4), y_m=st.floats(-1e4, 1e4), heading=st.floats(-pi, pi))
def test_a_road_anywhere_becomes_one_along_x(tmp_path_factory, x_m, y_m, heading):
    def turn(row):
        name, time_s, along, across = row
        c, s = cos(heading), sin(heading)
        return name, time_s, x_m + c * along - s * across, y_m + s * along + c * across

    folder = tmp_path_factory.mktemp("tracks")
    plain = read_tracks(write(folder / "a.csv", [*EGO, *OTHER]), "1")
    turned = write(folder / "b.csv", map(turn, [*EGO, *OTHER]))
    found = read_tracks(turned, "1", frame=RoadFrame(x_m, y_m, heading))
    assert found.states[..., :2] == pytest.approx(plain.states[..., :2], abs=1e-6)
    assert np.cos(found.states[..., 2]) == pytest.approx(np.cos(plain.states[..., 2]), abs=1e-6)
    assert np.sin(found.states[..., 2]) == pytest.approx(np.sin(plain.states[..., 2]), abs=1e-6)
    assert found.states[..., 3] == pytest.approx(plain.states[..., 3], abs=1e-6)


def test_headings_speeds_and_sizes_are_taken_from_the_file(tmp_path):
    header = (*HEADER, "heading_rad", "speed_mps", "length_m", "width_m")
    turning = [("1", t, 5.0 * t, 0.0, angle, 5.0, 16.0, 2.5) for t, angle in ((0, 3.1), (1, -3.1))]
    other = [("2", t, 50.0, 0.0, 0.0, 0.0, 4.0, 1.8) for t in (0, 1)]
    tracks = read_tracks(write(tmp_path / "a.csv", [*turning, *other], header), "1", 0.5)
    # From 3.1 to -3.1 it turns by the short way, through pi.
    assert tracks.states[:, 0, 2] == pytest.approx([3.1, pi, 2 * pi - 3.1])
    assert tracks.states[:, 0, 3] == pytest.approx(5.0)
    assert tracks.sizes.tolist() == [[16.0, 2.5], [4.0, 1.8]]


def test_a_vehicle_that_stands_keeps_its_direction(tmp_path):
    rows = [("1", t, 0.0, min(t, 1.0)) for t in (0.0, 1.0, 2.0, 3.0)]
    still = [("2", t, 9.0, 9.0) for t in (0.0, 3.0)]
    tracks = read_tracks(write(tmp_path / "a.csv", [*rows, *still]), "1", 0.5)
    assert tracks.states[:, 0, 2] == pytest.approx(pi / 2)
    assert tracks.states[:, 1, 2] == pytest.approx(0.0)


def test_a_vehicle_that_stands_has_the_direction_of_the_nearest_motion(tmp_path):
    """It goes along -x, waits, and turns off: its direction makes no turn in between."""
    x_m = [*np.arange(0.0, -10.0, -1.0), *[-9.0] * 10, *np.arange(-10.0, -20.0, -1.0)]
    y_m = [*[0.0, 1e-3] * 5, *[0.0] * 10, *np.arange(0.5, 5.5, 0.5)]
    rows = [("1", 0.1 * n, x, y) for n, (x, y) in enumerate(zip(x_m, y_m, strict=True))]
    other = [("2", t, 99.0, 0.0) for t in (0.0, 3.0)]
    heading = read_tracks(write(tmp_path / "a.csv", [*rows, *other]), "1").states[:, 0, 2]
    assert np.abs(heading - heading[0]).max() < 0.6
    assert np.cos(heading[:10]) == pytest.approx(-1.0, abs=1e-5)
    # Of the ten steps at rest the first half looks back, the second one ahead.
    assert len(np.unique(heading[10:20])) == 2


def test_vehicles_that_come_or_go_are_left_out_and_named(tmp_path):
    late, early = straight("late", [0.5, 1.0]), straight("early", [0.0, 0.8])
    tracks = read_tracks(write(tmp_path / "a.csv", [*EGO, *late, *OTHER, *early]), "1")
    assert (tracks.ids, tracks.left_out) == (("1", "2"), ("late", "early"))


@given(
    steps=st.integers(1, 30),
    dt_s=st.sampled_from([0.02, 0.04, 0.1, 0.25]),
    starts_s=st.floats(0.0, 1e4),
)
def test_recorded_positions_are_kept_where_a_step_falls_on_them(
    tmp_path_factory, steps, dt_s, starts_s
):
    times = [starts_s + dt_s * step for step in range(steps + 1)]
    rows = [("1", repr(t), 3.0 * step, step**0.5) for step, t in enumerate(times)]
    other = [("2", repr(t), 99.0, 0.0) for t in (times[0], times[-1])]
    path = write(tmp_path_factory.mktemp("tracks") / "a.csv", [*rows, *other])
    tracks = read_tracks(path, "1", dt_s)
    assert len(tracks.states) == steps + 1
    assert tracks.states[:, 0, 0] == pytest.approx([row[2] for row in rows], abs=1e-6)
    assert tracks.states[:, 0, 1] == pytest.approx([row[3] for row in rows], abs=1e-6)


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        ([*EGO, *OTHER, ("2", 3.0, "", 0.0)], "Row 8 has no x_m"),
        ([*EGO, *OTHER, ("2", 3.0, "fast", 0.0)], "x_m of vehicle '2' is 'fast'"),
        ([*EGO, *OTHER, ("2", 3.0, "nan", 0.0)], "no finite number"),
        ([*EGO, *OTHER, ("1", 0.5, 0.0, 0.0)], "two rows of one time"),
        (OTHER, "'1' is not in a.csv"),
        (EGO, "No other vehicle of a.csv is there as long"),
        ([*straight("1", [0.0, 0.05]), *OTHER], "less than a step"),
        ([], "'1' is not in a.csv"),
    ],
)
def test_tracks_that_cannot_be_used_are_refused(tmp_path, rows, words):
    with pytest.raises(InvalidValue, match=words):
        read_tracks(write(tmp_path / "a.csv", rows), "1")


@pytest.mark.parametrize("speeds", [("", 5.0), (5.0, "")])
def test_a_column_that_is_filled_for_some_times_of_a_vehicle_is_refused(tmp_path, speeds):
    rows = [("1", t, 5.0 * t, 0.0, speed) for t, speed in zip((0.0, 1.0), speeds, strict=True)]
    other = [("2", t, 50.0, 0.0, "") for t in (0.0, 1.0)]
    with pytest.raises(InvalidValue, match="speed_mps of vehicle '1'"):
        read_tracks(write(tmp_path / "a.csv", [*rows, *other], (*HEADER, "speed_mps")), "1")


@pytest.mark.parametrize("dt_s", [0.0, -0.1, float("nan"), float("inf")])
def test_a_step_without_a_duration_is_refused(tmp_path, dt_s):
    with pytest.raises(InvalidValue, match="not a positive number") as refused:
        read_tracks(write(tmp_path / "a.csv", [*EGO, *OTHER]), "1", dt_s)
    assert refused.value.field == "dt_s"


def test_the_ending_of_a_name_may_be_in_capitals(tmp_path):
    path = write_commonroad(tmp_path / "a.XML", ("1", 0.0, 0.0, 20.0), ("2", 30.0, 3.5, 15.0))
    assert read_tracks(path, "1").ids == ("1", "2")


@pytest.mark.parametrize(
    "name", ["none.csv", "none.parquet", "none.xml", "binary.csv", "text.parquet", "text.xml"]
)
def test_files_that_cannot_be_read_are_refused(tmp_path, name):
    (tmp_path / "binary.csv").write_bytes(b"\xff\xfe\x00")
    for text in ("text.parquet", "text.xml"):
        (tmp_path / text).write_text("id,time_s")
    with pytest.raises(InvalidValue, match="cannot be read"):
        read_tracks(tmp_path / name, "1")
