"""Recorded tracks: the same from each format, on one grid; what cannot be used is refused."""

import csv
import os
from math import atan2, cos, hypot, pi, sin

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eigenfail.errors import InvalidValue, UnknownName
from eigenfail_exchange.recorded_traffic import table
from eigenfail_exchange.recorded_traffic.columns import COLUMNS, USUAL_SIZE_M
from eigenfail_exchange.recorded_traffic.tracks import RoadFrame, read_tracks

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
OTHER = straight("2", [-1.0, -0.3, 0.25, 1.1, 2.0], (30.0, 3.5), (15.0, 0.0))


def test_tracks_are_interpolated_to_steps(tmp_path):
    tracks = read_tracks(write(tmp_path / "a.csv", [*OTHER, *EGO]), "1")
    time_s = np.arange(11) * 0.1
    assert (tracks.ids, tracks.dt_s, tracks.left_out) == (("1", "2"), 0.1, {})
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
    assert (tracks.ids, set(tracks.left_out)) == (("1", "2"), {"3", "9"})
    assert "no rectangle" in tracks.left_out["3"]
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
    turning = [("1", t, -5.0 * t, 0.0, angle, 5.0, 16.0, 2.5) for t, angle in ((0, 3.1), (1, -3.1))]
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


def test_vehicles_that_come_or_go_are_there_for_their_own_time(tmp_path):
    late, early = straight("late", [0.5, 1.0]), straight("early", [0.0, 0.8])
    tracks = read_tracks(write(tmp_path / "a.csv", [*EGO, *late, *OTHER, *early]), "1")
    # Those that are there at the start come first: their numbers are those of a scenario's actors.
    assert (tracks.ids, tracks.left_out) == (("1", "2", "early", "late"), {})
    there = np.isfinite(tracks.states).all(axis=2)
    assert there[:, 1].all()
    assert there[:, 2].tolist() == [step <= 8 for step in range(11)]
    assert there[:, 3].tolist() == [step >= 5 for step in range(11)]


@given(
    steps=st.integers(1, 30),
    dt_s=st.sampled_from([0.02, 0.04, 0.1, 0.25]),
    starts_s=st.floats(0.0, 1e4),
)
def test_recorded_positions_are_kept_where_a_step_falls_on_them(
    tmp_path_factory, steps, dt_s, starts_s
):
    times = [starts_s + dt_s * step for step in range(steps + 1)]
    rows = [("1", repr(t), 30.0 * dt_s * step, step**0.5) for step, t in enumerate(times)]
    other = [("2", repr(t), 99.0, 0.0) for t in (times[0], times[-1])]
    path = write(tmp_path_factory.mktemp("tracks") / "a.csv", [*rows, *other])
    tracks = read_tracks(path, "1", dt_s)
    assert len(tracks.states) == steps + 1
    assert tracks.states[:, 0, 0] == pytest.approx([row[2] for row in rows], abs=1e-6)
    assert tracks.states[:, 0, 1] == pytest.approx([row[3] for row in rows], abs=1e-6)


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        ([*EGO, *OTHER, ("2", 3.0, "", 0.0)], "row 11: x_m: is empty"),
        ([*EGO, *OTHER, ("2", 3.0, "fast", 0.0)], "row 11: x_m: 'fast' is not a finite number"),
        ([*EGO, *OTHER, ("2", 3.0, "nan", 0.0)], "not a finite number"),
        ([*EGO, *OTHER, ("1", 0.5, 0.0, 0.0)], "two rows of one time"),
        (OTHER, "'1' is not in a.csv"),
        (EGO, "No other vehicle of a.csv is there beside '1' at 0 s"),
        ([*straight("1", [0.0, 0.05]), *OTHER], "less than a step"),
        ([], "a.csv has no vehicle that can be used"),
    ],
)
def test_tracks_that_cannot_be_used_are_refused(tmp_path, rows, words):
    with pytest.raises(InvalidValue, match=words):
        read_tracks(write(tmp_path / "a.csv", rows), "1")


@pytest.mark.parametrize("speeds", [("", 4.8), (4.8, "")])
def test_a_column_that_some_rows_of_a_vehicle_lack_follows_from_its_positions(tmp_path, speeds):
    rows = [("1", t, 5.0 * t, 0.0, speed) for t, speed in zip((0.0, 1.0), speeds, strict=True)]
    other = [("2", t, 50.0 + 5.0 * t, 0.0, 4.8) for t in (0.0, 1.0)]
    path = write(tmp_path / "a.csv", [*rows, *other], (*HEADER, "speed_mps"))
    tracks = read_tracks(path, "1")
    assert tracks.states[:, 0, 3] == pytest.approx(5.0)
    assert tracks.states[:, 1, 3] == pytest.approx(4.8)
    assert tracks.notes == ("speed_mps of 1 follows from positions: some rows lack it.",)


def test_a_size_that_some_rows_of_a_vehicle_lack_is_that_of_the_others(tmp_path):
    rows = [(*row, "" if n == 50 else 12.0) for n, row in enumerate(LEAD)]
    path = write(tmp_path / "a.csv", [*drive("ego", more=("",)), *rows], (*HEADER, "length_m"))
    tracks = read_tracks(path, "ego")
    assert tracks.sizes[:, 0].tolist() == [5.0, 12.0]
    assert tracks.notes == ("length_m of lead is that of other rows: some rows lack it.",)


@pytest.mark.parametrize("gap_s", [0.0, -1.0, float("nan")])
def test_a_longest_gap_without_a_duration_is_refused(tmp_path, gap_s):
    with pytest.raises(InvalidValue, match="not a positive number") as refused:
        read_tracks(write(tmp_path / "a.csv", [*EGO, *OTHER]), "1", longest_gap_s=gap_s)
    assert refused.value.field == "longest_gap_s"


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


def drive(name, x_m=0.0, y_m=0.0, speed=20.0, begins=0, ends=100, more=()):  # noqa: PLR0917
    """Rows of a vehicle at constant speed along x, every 0.1 s, with further cells."""
    return [
        (name, round(0.1 * n, 1), x_m + speed * 0.1 * n, y_m, *more)
        for n in range(begins, ends + 1)
    ]


LEAD = drive("lead", 60.0)


@pytest.mark.parametrize(
    ("speed", "heading", "words"),
    [
        (-18.0, 180.0, "headings seem to be in degrees"),
        (-18.0, 0.0, "seem to be those of the rear"),
        (20.0, 2.0, "seem to be in degrees"),
        (20.0, 90.0, "compass directions in degrees"),
        (20.0, pi / 2, "seem to be compass directions"),
        (20.0, -999.0, "is -999 at 0 s, and it moves in the direction 0 rad"),
        (0.0, 90.0, "is 90 at 0 s, and it stands"),
    ],
)
def test_headings_that_contradict_the_motion_are_refused(tmp_path, speed, heading, words):
    ego = drive("ego", more=(0.0,))
    car = drive("car", 180.0, 3.5, speed, more=(heading,))
    path = write(tmp_path / "a.csv", [*ego, *car], (*HEADER, "heading_rad"))
    with pytest.raises(InvalidValue, match=words) as refused:
        read_tracks(path, "ego")
    assert refused.value.field == "heading_rad"


@pytest.mark.parametrize(
    ("speed", "heading"), [(20.0, 4 * pi), (20.0, 0.3), (-18.0, -pi), (0.0, 1.5)]
)
def test_headings_that_fit_the_motion_are_taken(tmp_path, speed, heading):
    ego = drive("ego", more=(0.0,))
    car = drive("car", 180.0, 3.5, speed, more=(heading,))
    path = write(tmp_path / "a.csv", [*ego, *car], (*HEADER, "heading_rad"))
    assert read_tracks(path, "ego").states[0, 1, 2] == pytest.approx(heading)


def weave(unit=1.0, noise=0.0, size_m=0.12, seed=1, road_rad=0.0):
    """Rows of three vehicles that sway a little in their lanes, with headings in a unit."""
    random = np.random.default_rng(seed)
    rows = []
    for number in range(3):
        for n in range(201):
            t, phase = 0.1 * n, 2.0 * number
            x, y = 20.0 * t + 40.0 * number, size_m * np.sin(t + phase)
            heading = road_rad + np.arctan(size_m * np.cos(t + phase) / 20.0)
            c, s = cos(road_rad), sin(road_rad)
            told = unit * (heading + noise * random.standard_normal())
            rows.append((f"v{number}", round(t, 1), c * x - s * y, s * x + c * y, told))
    return rows


DEGREES = 180.0 / pi


@pytest.mark.parametrize("size_m", [0.05, 0.12, 0.15])
@pytest.mark.parametrize("noise", [0.0, 0.001])
@pytest.mark.parametrize("road_rad", [0.0, 0.001])
def test_small_headings_in_degrees_are_refused(tmp_path, size_m, noise, road_rad):
    rows = weave(DEGREES, noise, size_m, road_rad=road_rad)
    path = write(tmp_path / "a.csv", rows, (*HEADER, "heading_rad"))
    with pytest.raises(InvalidValue, match="headings seem to be in degrees") as refused:
        read_tracks(path, "v0")
    assert refused.value.field == "heading_rad"


@pytest.mark.parametrize("size_m", [0.0, 0.02, 0.12, 1.0])
@pytest.mark.parametrize("noise", [0.0, 0.01, 0.1])
@pytest.mark.parametrize("road_rad", [0.0, 0.005, 3.1])
def test_small_headings_in_radians_are_taken(tmp_path, size_m, noise, road_rad):
    for seed in range(3):
        rows = weave(1.0, noise, size_m, seed, road_rad)
        tracks = read_tracks(write(tmp_path / f"{seed}.csv", rows, (*HEADER, "heading_rad")), "v0")
        assert tracks.notes == ()


def test_constant_headings_beside_the_motion_are_refused_in_most_vehicles(tmp_path):
    rows = [*drive("ego", more=(0.3,)), *drive("lead", 60.0, more=(0.25,))]
    path = write(tmp_path / "a.csv", rows, (*HEADER, "heading_rad"))
    with pytest.raises(InvalidValue, match=r"'ego', 'lead' differs .* 0.3 rad \(17°\) in the med"):
        read_tracks(path, "ego")


def test_a_constant_heading_beside_the_motion_is_noted_in_few_vehicles(tmp_path):
    rows = [*drive("ego", more=(0.0,)), *drive("lead", 60.0, more=(0.3,))]
    tracks = read_tracks(write(tmp_path / "a.csv", rows, (*HEADER, "heading_rad")), "ego")
    (note,) = tracks.notes
    assert note.startswith("The heading of 'lead' differs from the direction of the motion by")


def test_vehicles_that_turn_tightly_have_no_other_unit(tmp_path):
    rows = []
    for number in range(3):
        for n in range(101):
            # The centre of a vehicle turns about the rear axle: it slips by 0.1 rad.
            turn = 0.06 * n
            place = (14.0 * sin(turn) + 50.0 * number, -14.0 * cos(turn))
            rows.append((f"v{number}", round(0.1 * n, 1), *place, turn - 0.1))
    path = write(tmp_path / "a.csv", rows, (*HEADER, "heading_rad"))
    assert read_tracks(path, "v0").notes == ()


def back_up(heading=0.0, lasts_s=3.0, speed=None):
    """Rows of a vehicle that stands, backs up at 4 m/s for a while, and stands again."""
    rows = []
    for n in range(101):
        way_m = 4.0 * min(max(0.1 * n - 2.0, 0.0), lasts_s)
        told = () if speed is None else (speed if 2.0 < 0.1 * n <= 2.0 + lasts_s else 0.0,)
        rows.append(("car", round(0.1 * n, 1), 120.0 - way_m, 3.5, heading, *told))
    return rows


@pytest.mark.parametrize("ego", ["ego", "second", "third"])
def test_reversed_headings_of_slow_traffic_are_refused(tmp_path, ego):
    rows = [
        *drive("ego", speed=4.5, ends=200, more=(pi,)),
        *drive("second", 40.0, speed=3.0, ends=200, more=(pi,)),
        *drive("third", 20.0, 3.5, speed=4.0, ends=200, more=(pi,)),
    ]
    rows = [(*row[:4], pi if row[0] == ego else 0.0) for row in rows]
    path = write(tmp_path / "a.csv", rows, (*HEADER, "heading_rad"))
    with pytest.raises(InvalidValue, match=f"'{ego}' is .* those of the rear, reversed"):
        read_tracks(path, "ego")


def test_an_ego_that_reverses_is_refused(tmp_path):
    path = write(
        tmp_path / "a.csv", [*back_up(), *drive("b", more=(0.0,))], (*HEADER, "heading_rad")
    )
    with pytest.raises(InvalidValue, match=r"'car' is 0 at .* those of the rear, reversed"):
        read_tracks(path, "car")


def test_a_vehicle_that_reverses_for_a_short_way_is_noted(tmp_path):
    rows = [*drive("ego", more=(0.0,)), *back_up()]
    tracks = read_tracks(write(tmp_path / "a.csv", rows, (*HEADER, "heading_rad")), "ego")
    assert (tracks.states[:, 1, 2] == 0.0).all()
    (note,) = tracks.notes
    assert note.startswith("'car' is taken as reversing between 2")


@pytest.mark.parametrize("noise_m", [0.0, 0.03])
def test_a_vehicle_that_reverses_has_negative_speeds_by_its_positions(tmp_path, noise_m):
    noise = noise_m * np.random.default_rng(1).normal(size=101)
    car = [(*row[:2], row[2] + dx, *row[3:]) for row, dx in zip(back_up(), noise, strict=True)]
    rows = [*drive("ego", more=(0.0,)), *car]
    states = read_tracks(write(tmp_path / "a.csv", rows, (*HEADER, "heading_rad")), "ego").states
    assert (states[:, 1, 2] == 0.0).all()
    assert states[26:45, 1, 3] == pytest.approx(-4.0, abs=0.3)
    assert np.abs(states[60:, 1, 3]).max() < 0.01
    assert states[:, 0, 3] == pytest.approx(20.0)


@pytest.mark.parametrize("told", [4.0, -4.0])
def test_speeds_of_a_vehicle_that_reverses_are_made_negative(tmp_path, told):
    rows = [*drive("ego", more=(0.0, 20.0)), *back_up(speed=told)]
    header = (*HEADER, "heading_rad", "speed_mps")
    tracks = read_tracks(write(tmp_path / "a.csv", rows, header), "ego")
    assert tracks.states[:, 1, 3].min() == -4.0
    assert tracks.states[:, 1, 3].max() == 0.0
    assert any(
        "Speeds of 'car' are taken as negative at 30 times" in note for note in tracks.notes
    ) == (told > 0.0)


def test_few_headings_that_contradict_the_motion_are_noted(tmp_path):
    car = [(*row, pi if n == 50 else 0.0) for n, row in enumerate(LEAD)]
    path = write(tmp_path / "a.csv", [*drive("ego", more=(0.0,)), *car], (*HEADER, "heading_rad"))
    tracks = read_tracks(path, "ego")
    assert tracks.notes == ("The heading of 'lead' contradicts its motion at 1 times.",)


@pytest.mark.parametrize(
    ("speed", "words"), [(72.0, "in km/h"), (44.7, "miles per hour"), (2.0, "moves at 20 m/s")]
)
def test_speeds_that_contradict_the_motion_are_refused(tmp_path, speed, words):
    rows = [*drive("ego", more=(speed,)), *drive("lead", 60.0, more=(speed,))]
    with pytest.raises(InvalidValue, match=words):
        read_tracks(write(tmp_path / "a.csv", rows, (*HEADER, "speed_mps")), "ego")


@pytest.mark.parametrize(("heading", "is_refused"), [(0.0, True), (None, True), (pi, False)])
def test_a_negative_speed_is_that_of_a_vehicle_that_reverses(tmp_path, heading, is_refused):
    more = () if heading is None else (heading,)
    rows = [*drive("ego", more=(20.0, *more)), *drive("lead", 60.0, speed=3.0, more=(-3.0, *more))]
    rows = [(*row[:5], *((0.0,) if more and row[0] == "ego" else row[5:])) for row in rows]
    header = (*HEADER, "speed_mps", *(("heading_rad",) if more else ()))
    path = write(tmp_path / "a.csv", rows, header)
    if is_refused:
        with pytest.raises(InvalidValue, match="'lead' is negative at 0 s, and the vehicle moves"):
            read_tracks(path, "ego")
    else:
        assert read_tracks(path, "ego").states[0, 1, 3] == -3.0


def test_a_vehicle_ends_at_a_long_gap_and_its_parts_are_named(tmp_path):
    car = [*drive("car", 70.0, 3.5, 18.0, ends=20), *drive("car", 70.0, 3.5, 18.0, 85)]
    path = write(tmp_path / "a.csv", [*drive("ego"), *LEAD, *car])
    tracks = read_tracks(path, "ego")
    assert tracks.ids == ("ego", "lead", "car, part 1", "car, part 2")
    assert np.isnan(tracks.states[21:, 2]).all()
    assert np.isnan(tracks.states[:85, 3]).all()
    assert "'car' is lost from 2 s to 8.5 s" in tracks.notes[0]
    assert "'car, part 2' (8.5 s to 10 s)" in tracks.notes[0]
    assert read_tracks(path, "ego", longest_gap_s=7.0).ids == ("ego", "lead", "car")
    with pytest.raises(InvalidValue, match=r"'car' is lost .* Choose a part of it: 'car, part 1'"):
        read_tracks(path, "car")
    assert read_tracks(path, "car, part 2").ids[0] == "car, part 2"


@pytest.mark.parametrize("pause", [0, 5, 21])
def test_an_id_of_two_cars_makes_two_vehicles(tmp_path, pause):
    first = drive("7", 90.0, 0.0, 25.0, ends=40)
    second = drive("7", -150.0, 3.5, 25.0, 41 + pause)
    tracks = read_tracks(write(tmp_path / "a.csv", [*drive("ego"), *LEAD, *first, *second]), "ego")
    assert tracks.ids == ("ego", "lead", "7, part 1", "7, part 2")
    assert np.nanmin(tracks.states[..., 0]) >= -150.0
    assert np.nanmax(tracks.states[..., 3]) == pytest.approx(25.0)
    assert "'7' " in tracks.notes[0]


@pytest.mark.parametrize(("noise_m", "dt_s"), [(0.1, 0.04), (0.5, 0.1), (1.0, 0.5)])
def test_noisy_positions_are_no_jumps_and_contradict_nothing(tmp_path, noise_m, dt_s):
    random = np.random.default_rng(1)
    rows = []
    for number in range(30):
        lasts = np.arange(0.0, 20.0 + dt_s, dt_s)
        noise = noise_m * random.standard_normal((len(lasts), 2))
        speed = random.uniform(0.0, 35.0)
        for t, (dx, dy) in zip(lasts, noise, strict=True):
            heading = 0.05 * random.standard_normal()
            told = max(speed + 0.3 * random.standard_normal(), 0.0)
            rows.append((number, t, 40 * number + speed * t + dx, dy, heading, told))
    path = write(tmp_path / "a.csv", rows, (*HEADER, "heading_rad", "speed_mps"))
    tracks = read_tracks(path, "0")
    assert (len(tracks.ids), tracks.left_out) == (30, {})
    assert not any("jumps" in note or "lost" in note for note in tracks.notes)


def test_an_id_of_two_cars_at_once_is_left_out(tmp_path):
    first, second = drive("7", 90.0), drive("7", -150.0, 3.5)
    both = [first[n] if n % 2 else second[n] for n in range(101)]
    tracks = read_tracks(write(tmp_path / "a.csv", [*drive("ego"), *LEAD, *both]), "ego")
    assert (tracks.ids, list(tracks.left_out)) == (("ego", "lead"), ["7"])
    assert "may be that of several vehicles" in tracks.left_out["7"]


def test_one_wrong_position_does_not_move_a_vehicle(tmp_path):
    rows = drive("car", 40.0, 3.5)
    rows[50] = ("car", 5.0, -1000.0, -1000.0)
    tracks = read_tracks(write(tmp_path / "a.csv", [*drive("ego"), *LEAD, *rows]), "ego")
    assert tracks.ids == ("ego", "lead", "car, part 1", "car, part 2")
    assert "jumps by" in tracks.notes[0]
    assert tracks.notes[1:] == ("1 row of 'car' at 5 s is left out.",)


def test_a_vehicle_of_single_rows_is_left_out_by_name(tmp_path):
    rows = [("car", float(t), x_m, 3.5) for t, x_m in ((0, 60.0), (4, 140.0), (8, 220.0))]
    tracks = read_tracks(write(tmp_path / "a.csv", [*drive("ego"), *LEAD, *rows]), "ego")
    assert (tracks.ids, tracks.notes) == (("ego", "lead"), ())
    assert tracks.left_out["car"].startswith("It is lost from 0 s to 4 s, is lost from 4 s to 8 s.")


def test_a_car_that_brakes_hard_does_not_jump(tmp_path):
    time_s = 0.5 * np.arange(21)
    x_m = [60 + 30 * t - 4.5 * t**2 if t < 10 / 3 else 110.0 for t in time_s]
    rows = [("car", t, x, 0.0) for t, x in zip(time_s, x_m, strict=True)]
    tracks = read_tracks(write(tmp_path / "a.csv", [*drive("ego", speed=5.0), *rows]), "ego")
    assert (tracks.ids, tracks.notes) == (("ego", "car"), ())


@pytest.mark.parametrize(
    ("scale", "words"),
    [(1e3, "milliseconds"), (1e6, "microseconds"), (1e9, "nanoseconds"), (30.0, "3 s apart")],
)
def test_times_in_another_unit_are_refused_before_anything_is_allocated(tmp_path, scale, words):
    rows = [(name, round(scale * t), x, y) for name, t, x, y in [*drive("ego"), *LEAD]]
    with pytest.raises(InvalidValue, match=words):
        read_tracks(write(tmp_path / "a.csv", rows), "ego")


@pytest.mark.parametrize("ends_s", [2_000.0, 1e12, 1e308])
def test_a_recording_of_more_steps_than_an_episode_is_refused(tmp_path, ends_s):
    rows = [("ego", t, 0.02 * t if t < 1e7 else 0.0, 0.0) for t in (0.0, ends_s)]
    with pytest.raises(InvalidValue, match=r"at most 10,000|reaches"):
        read_tracks(write(tmp_path / "a.csv", [*rows, *LEAD]), "ego", longest_gap_s=1e309)


def test_more_vehicles_than_have_numbers_are_refused(tmp_path):
    many = [row for n in range(1_000) for row in drive(str(n), 30.0 * n, 3.5, ends=1)]
    with pytest.raises(InvalidValue, match="has 1,000 vehicles beside 'ego'"):
        read_tracks(write(tmp_path / "a.csv", [*drive("ego"), *many]), "ego")


@pytest.mark.parametrize(
    "dialect",
    [
        lambda text: "\ufeff" + text,
        lambda text: text.replace(",", ";"),
        lambda text: text.replace(",", "\t"),
        lambda text: text.replace(",", ", "),
        lambda text: text.replace(",", " "),
        lambda text: text.replace(HEADER[0], "ID").replace("x_m", " X_m ").replace("y_m", "Y_M"),
        lambda text: text.replace("\n", "\r\n") + "\r\n\r\n",
    ],
)
def test_dialects_of_csv_are_read_alike(tmp_path, dialect):
    path = write(tmp_path / "a.csv", [*drive("ego"), *LEAD])
    plain = read_tracks(path, "ego")
    (tmp_path / "b.csv").write_text(dialect(path.read_text()), encoding="utf-8", newline="")
    found = read_tracks(tmp_path / "b.csv", "ego")
    assert np.array_equal(found.states, plain.states)
    assert found.ids == plain.ids


@pytest.mark.parametrize(
    ("header", "words"),
    [
        ("frame,id,x,y,width,height,xVelocity", "its columns are frame, id, x, y, width"),
        ("id,time,x_m,y_m", "column time_s is missing.*Convert time, if it is in another unit"),
        ("id,time_ms,x_m,y_m", "column time_s is missing.*Convert time_ms, if it is in another"),
        ("id,time_s,x_m,length_m", r"column y_m is missing; its columns are [\w, ]*\. A track has"),
        ("0,1,2.5,3", "its first line has numbers"),
        ("id,time_s,x_m,y_m,heading_deg", "heading_deg is not read, and column heading_rad"),
        ("id,time_s,x_m,y_m,speed_kmh", "speed_kmh is not read, and column speed_mps"),
        ("id,time_s,x_m,y_m,Speed [km/h]", "is not read, and column speed_mps"),
        ("id,time_s,x_m,y_m,widht_m", "widht_m is not read, and column width_m"),
        ("id,time,x_m,y", "columns time_s, y_m are missing"),
        ("id,time_s,x_m,y_m,length", "length is not read, and column length_m"),
        ("id,time_s,x_m,x_m,y_m", "two columns x_m"),
    ],
)
def test_columns_that_do_not_fit_are_refused_by_name(tmp_path, header, words):
    path = write(tmp_path / "a.csv", [*drive("ego"), *LEAD], header.split(","))
    with pytest.raises(InvalidValue, match=words):
        read_tracks(path, "ego")


def test_columns_of_other_quantities_in_units_are_noted(tmp_path):
    names = ("lane_width_m", "speed_limit_mps")
    rows = [*drive("ego", more=(3.5, 30)), *drive("lead", 60.0, more=(3.5, 30))]
    tracks = read_tracks(write(tmp_path / "a.csv", rows, (*HEADER, *names)), "ego")
    assert tracks.notes == ("Columns that are not read: lane_width_m, speed_limit_mps.",)


def test_other_columns_are_noted(tmp_path):
    rows = [*drive("ego", more=(1, 2)), *drive("lead", 60.0, more=(1, 2))]
    tracks = read_tracks(write(tmp_path / "a.csv", rows, (*HEADER, "lane", "Frame")), "ego")
    assert tracks.notes == ("Columns that are not read: lane, Frame.",)


@pytest.mark.parametrize(("line", "words"), [("a,1,5,2,3\n", "5 cells"), ("a;1,5;2;3\n", "comma")])
def test_decimal_commas_are_named(tmp_path, line, words):
    path = tmp_path / "a.csv"
    path.write_text("id;time_s;x_m;y_m\n".replace(";", ";" if ";" in line else ",") + line)
    with pytest.raises(InvalidValue, match=words):
        read_tracks(path, "a")


@pytest.mark.parametrize("line", ["b 0  60 0.1 15", "b 0 60 0.1", "b 0 60 0 0.1 15 2"])
def test_a_row_of_other_cells_between_blanks_is_refused(tmp_path, line):
    path = tmp_path / "a.csv"
    path.write_text(f"id time_s x_m y_m heading_rad speed_mps\na 0 0 0 0 15 \n{line}\n")
    with pytest.raises(InvalidValue, match=r"row 3: has \d cells, and the header 6"):
        read_tracks(path, "a")


@pytest.mark.parametrize("size", [(0.0, 2.0), (5.0, -5.0), (450.0, 180.0), (5.0, 25.0)])
def test_sizes_that_no_vehicle_has_are_refused(tmp_path, size):
    rows = [*drive("ego", more=size), *drive("lead", 60.0, more=size)]
    with pytest.raises(InvalidValue, match=r"(length|width)_m of vehicle .* must be above 0"):
        read_tracks(write(tmp_path / "a.csv", rows, (*HEADER, "length_m", "width_m")), "ego")


def test_places_that_are_not_on_earth_are_refused(tmp_path):
    rows = [("far", 0.0, 1e308, 0.0), ("far", 0.5, -1e308, 0.0)]
    with pytest.raises(InvalidValue, match=r"x_m of vehicle 'far' is 1e\+308"):
        read_tracks(write(tmp_path / "a.csv", [*drive("ego"), *LEAD, *rows]), "ego")


def test_places_far_from_the_road_are_refused_without_a_frame(tmp_path):
    rows = [(name, t, x + 691e3, y + 5334e3) for name, t, x, y in [*drive("ego"), *LEAD]]
    path = write(tmp_path / "a.csv", rows)
    with pytest.raises(InvalidValue, match="'ego' is at x = 691000 m, y = 5334000 m") as refused:
        read_tracks(path, "ego")
    assert "`frame`, the place of the road" in str(refused.value)
    states = read_tracks(path, "ego", frame=RoadFrame(691e3, 5334e3)).states
    assert states[:, 0, 0] == pytest.approx(2.0 * np.arange(101))


def test_a_short_parquet_file_of_many_rows_is_refused(tmp_path, monkeypatch):
    import pyarrow as pa
    from pyarrow import parquet

    monkeypatch.setattr(table, "COLUMNS", COLUMNS._replace(most_rows=1_000))
    cells = {"id": ["a"] * 1_001, **{name: [0.0] * 1_001 for name in HEADER[1:]}}
    parquet.write_table(pa.table(cells), tmp_path / "a.parquet")
    with pytest.raises(InvalidValue, match="more than 1,000 rows"):
        read_tracks(tmp_path / "a.parquet", "a")


@pytest.mark.parametrize("name", ["pipe.csv", "pipe.parquet", "pipe.xml"])
def test_a_pipe_is_refused_at_once(tmp_path, name):
    os.mkfifo(tmp_path / name)
    with pytest.raises(InvalidValue, match="not a regular file"):
        read_tracks(tmp_path / name, "ego")


def test_vehicles_are_left_out_on_purpose_by_name(tmp_path):
    path = write_commonroad(tmp_path / "a.xml", ("1", 0.0, 0.0, 20.0), ("2", 30.0, 3.5, 15.0))
    tracks = read_tracks(path, "1", without=["9"])
    assert tracks.left_out == {}
    with pytest.raises(UnknownName, match="'8'"):
        read_tracks(path, "1", without=["8"])


def test_a_text_is_refused_as_a_list_of_vehicles(tmp_path):
    rows = [*EGO, *OTHER, *straight("3", TIMES, (60.0, 0.0))]
    with pytest.raises(InvalidValue, match="Give a list") as refused:
        read_tracks(write(tmp_path / "a.csv", rows), "1", without="23")
    assert refused.value.field == "without"


def test_numbers_name_vehicles_of_these_ids(tmp_path):
    rows = [*EGO, *OTHER, *straight("3", TIMES, (60.0, 0.0))]
    assert read_tracks(write(tmp_path / "a.csv", rows), 1, without=[3]).ids == ("1", "2")


CARS = ("1", 0.0, 0.0, 20.0), ("2", 30.0, 3.5, 15.0), ("3", 90.0, 0.0, 20.0)


def change_commonroad(tmp_path, *changes):
    """A file of CARS with texts replaced, without the obstacle that has no state."""
    path = write_commonroad(tmp_path / "a.xml", *CARS)
    text = path.read_text().replace(
        '<dynamicObstacle id="9"><type>car</type></dynamicObstacle>', ""
    )
    for old, new in changes:
        assert old in text
        text = text.replace(old, new)
    path.write_text(text)
    return path


PARKED = f"""<staticObstacle id="7"><type>parkedVehicle</type><shape><rectangle><length>4</length>
<width>1.8</width></rectangle></shape>{
    STATE.format(tag="initialState", x=60.0, y=0.0, heading=0.1, step=0, speed=0.0)
}</staticObstacle></commonRoad>"""


def test_a_static_obstacle_stands_all_the_time(tmp_path):
    tracks = read_tracks(change_commonroad(tmp_path, ("</commonRoad>", PARKED)), "1")
    assert (tracks.ids, tracks.left_out) == (("1", "2", "3", "7"), {})
    assert tracks.states[:, 3].tolist() == [[60.0, 0.0, 0.1, 0.0]] * 11
    assert tracks.sizes[3].tolist() == [4.0, 1.8]


def test_commonroad_2018b_is_read_like_2020a(tmp_path):
    plain = read_tracks(change_commonroad(tmp_path, ("</commonRoad>", PARKED)), "1")
    static = PARKED.replace('<staticObstacle id="7">', '<obstacle id="7"><role>static</role>')
    path = change_commonroad(
        tmp_path,
        ("<dynamicObstacle id", "<obstacle_id"),
        ("<type>car</type>", "<role>dynamic</role><type>car</type>"),
        ("<obstacle_id", "<obstacle id"),
        ("</dynamicObstacle>", "</obstacle>"),
        ("</commonRoad>", static.replace("</staticObstacle>", "</obstacle>")),
        ("<commonRoad ", '<commonRoad xmlns="http://c.org/2018" commonRoadVersion="2018b" '),
    )
    old = read_tracks(path, "1")
    assert (old.ids, old.left_out) == (plain.ids, plain.left_out)
    assert np.array_equal(old.states, plain.states)


INTERVAL = "<velocity><intervalStart>14</intervalStart><intervalEnd>16</intervalEnd></velocity>"


@pytest.mark.parametrize(
    ("old", "new", "why"),
    [
        ("<velocity><exact>15.0</exact></velocity>", INTERVAL, "no velocity/exact"),
        ("<y>3.5</y>", "", "no position/point/y"),
        ("<y>3.5</y>", "<y>nan</y>", "is nan"),
    ],
)
def test_an_uncertain_obstacle_is_left_out_alone(tmp_path, old, new, why):
    tracks = read_tracks(change_commonroad(tmp_path, (old, new)), "1")
    assert (tracks.ids, list(tracks.left_out)) == (("1", "3"), ["2"])
    assert why in tracks.left_out["2"]


def test_a_missing_velocity_follows_from_positions(tmp_path):
    path = change_commonroad(tmp_path, ("<velocity><exact>15.0</exact></velocity>", ""))
    tracks = read_tracks(path, "1")
    assert tracks.left_out == {}
    assert tracks.states[:, 1, 3] == pytest.approx(15.0)


OTHERS = """<lanelet id="5"/><lanelet id="6"/><planningProblem id="100"/>
<phantomObstacle id="8"/></commonRoad>"""


def test_whatever_else_commonroad_has_is_named(tmp_path):
    path = change_commonroad(
        tmp_path,
        ("</commonRoad>", OTHERS),
        ("<commonRoad ", '<commonRoad comment="a" '),
        ("</trajectory>", "</trajectory><signalSeries/>"),
        ("<orientation>", "<acceleration/><orientation>"),
    )
    tracks = read_tracks(path, "1")
    assert list(tracks.left_out) == ["8"]
    said = " ".join(tracks.notes)
    for name in ("'100'", "lanelet (2)", "signalSeries", "acceleration", "comment", "type"):
        assert name in said
    with pytest.raises(InvalidValue, match=r"'100' is not in .* planningProblem '100' is not read"):
        read_tracks(path, "100")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("<commonRoad ", '<?xml version="1.0" encoding="foo"?><commonRoad ', "not XML.*foo"),
        ("0.1", "1e300", "timeStepSize is '1e300'"),
        ("<commonRoad ", '<commonRoad commonRoadVersion="2017a" ', "version .* is '2017a'"),
        ("commonRoad", "OpenSCENARIO", "not CommonRoad XML, but has <OpenSCENARIO>"),
        ("dynamicObstacle", "dynamicobstacle", "has no vehicle .* dynamicobstacle"),
        ('<dynamicObstacle id="2">', '<dynamicObstacle id="1">', "two obstacles of the id '1'"),
    ],
)
def test_commonroad_of_another_kind_is_refused_with_the_cause(tmp_path, old, new, words):
    path = write_commonroad(tmp_path / "a.xml", *CARS)
    path.write_text(path.read_text().replace(old, new))
    with pytest.raises(InvalidValue, match=words):
        read_tracks(path, "1")


def park(noise_m, step_m=None, rows=101, more=(), seed=1):
    """Rows of a parked vehicle with noisy positions, every 0.1 s."""
    places = np.array([100.0, 3.3]) + noise_m * np.random.default_rng(seed).normal(size=(rows, 2))
    if step_m:
        places = np.round(np.round(places / step_m) * step_m, 6)
    return [("car", round(0.1 * n, 1), x, y, *more) for n, (x, y) in enumerate(places.tolist())]


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize(
    ("noise_m", "step_m", "speed"),
    [
        (0.02, None, None),
        (0.05, None, None),
        (0.03, None, 0.0),
        (0.02, 0.1, None),
        (0.05, 0.1, None),
    ],
)
def test_noise_does_not_turn_a_vehicle_that_stands(tmp_path, noise_m, step_m, speed, seed):
    told, own = ((20.0,), (speed,)) if speed is not None else ((), ())
    rows = [*drive("ego", more=told), *park(noise_m, step_m, more=own, seed=seed)]
    header = (*HEADER, "speed_mps") if told else HEADER
    states = read_tracks(write(tmp_path / "a.csv", rows, header), "ego").states
    assert states[:, 1, 2:] == pytest.approx(0.0, abs=1e-9)


@pytest.mark.parametrize("step_m", [None, 0.1])
@pytest.mark.parametrize("heading", [0.0, 2.0])
def test_a_noisy_vehicle_that_stops_keeps_its_direction(tmp_path, heading, step_m):
    way_m = np.minimum(8.0 * 0.1 * np.arange(101), 40.0)
    noise = 0.03 * np.random.default_rng(1).normal(size=(101, 2))
    places = np.array([100.0, 3.3]) + way_m[:, None] * [cos(heading), sin(heading)] + noise
    if step_m:
        places = np.round(places, 1)
    rows = [("car", round(0.1 * n, 1), x, y) for n, (x, y) in enumerate(places.tolist())]
    states = read_tracks(write(tmp_path / "a.csv", [*drive("ego"), *rows]), "ego").states[:, 1]
    assert states[:, 2] == pytest.approx(heading, abs=0.15)
    assert states[:44, 3] == pytest.approx(8.0, abs=0.4)
    assert (states[57:, 3] == 0.0).all()


def test_a_slow_vehicle_of_noisy_positions_moves_from_its_first_row_to_its_last(tmp_path):
    noise = 0.3 * np.random.default_rng(1).normal(size=(101, 2))
    rows = [
        (*row[:2], row[2] + dx, row[3] + dy)
        for row, (dx, dy) in zip(drive("car", 60.0, speed=4.0), noise.tolist(), strict=True)
    ]
    states = read_tracks(write(tmp_path / "a.csv", [*drive("ego"), *rows]), "ego").states
    assert states[:, 1, 3] == pytest.approx(4.0, abs=1.6)
    assert states[:, 1, 2] == pytest.approx(0.0, abs=0.4)


@pytest.mark.parametrize("noise_m", [0.0, 0.03])
def test_a_vehicle_that_never_moves_points_along_the_road(tmp_path, noise_m):
    rows = [(name, t, -y, x) for name, t, x, y in [*drive("ego"), *park(noise_m)]]
    path = write(tmp_path / "a.csv", rows)
    states = read_tracks(path, "ego", frame=RoadFrame(heading_rad=pi / 2)).states
    assert states[..., 2] == pytest.approx(0.0, abs=1e-9)


def test_motion_without_noise_is_that_between_steps(tmp_path):
    time_s = np.round(0.1 * np.arange(101), 1)
    x_m, y_m = 60.0 + 20.0 * time_s - 2.0 * np.minimum(time_s, 5.0) ** 2, 3.5 * np.sin(time_s / 3)
    rows = [("car", *row) for row in zip(time_s, x_m, y_m, strict=True)]
    states = read_tracks(write(tmp_path / "a.csv", [*drive("ego"), *rows]), "ego").states
    grid_s = 0.1 * np.arange(101)
    along, across = (np.gradient(np.interp(grid_s, time_s, each), grid_s) for each in (x_m, y_m))
    assert np.array_equal(states[:, 1, 3], np.hypot(along, across))
    assert np.array_equal(states[:, 1, 2], np.unwrap(np.arctan2(across, along)))


def test_length_and_width_that_are_exchanged_are_refused(tmp_path):
    rows = ["id,time_s,x_m,y_m,length_m,width_m"]
    for k in range(30):
        rows += [f"a,{k / 10},{2 * k},0,2.5,16", f"b,{k / 10},{2 * k + 50},0,4.8,1.9"]
    file = tmp_path / "sizes.csv"
    file.write_text("\n".join(rows))
    with pytest.raises(InvalidValue, match=r"'a' is 16 m wide, 2\.5 m long, and moves\. Exchange"):
        read_tracks(file, ego="b")
    file.write_text(file.read_text().replace("2.5,16", "16,2.5"))
    assert read_tracks(file, ego="b").sizes[1].tolist() == [16.0, 2.5]
