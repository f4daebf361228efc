"""Fits find the models that logs were drawn from, and checks tell logs that are of none."""

from itertools import pairwise
from math import nan

import msgspec
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from eigenfail.errors import InvalidValue
from eigenfail.values.disturbance import AXES, Conversion, DisturbanceModel, NoiseTrajectory
from eigenfail.values.shapes import Correlated, HeavyTailed, White
from eigenfail_noise_fit import fitting, jackknife
from eigenfail_noise_fit.checks import check_position
from eigenfail_noise_fit.log_file import read_log
from eigenfail_noise_fit.sensor_log import FEWEST_TRACKS, Row, make_log

SHAPES = {"white": White(), "ar1": Correlated(0.8, 0.4), "student_t": HeavyTailed(4.0)}


def draw(benchmark, kind, bend=None):
    """A log of a model of this shape, and the model."""
    model = DisturbanceModel(0.03, 0.8, 0.05, 0.3, shape=SHAPES[kind])
    return benchmark.draw_log(model, np.random.default_rng(11), bend), model


def list_parameters(model):
    """The parameters of a model in the order of the fits, as these have them."""
    own = {
        White: list,
        Correlated: lambda: [
            model.shape.longitudinal_correlation,
            model.shape.lateral_correlation,
        ],
        HeavyTailed: lambda: [1.0 / model.shape.degrees_of_freedom],
    }
    common = [getattr(model, name) for name in DisturbanceModel.__struct_fields__[:4]]
    return np.array([*common, *own[type(model.shape)]()])


@pytest.fixture(scope="module", params=SHAPES)
def fitted(request, benchmark):
    """A log of a model of each shape, the model, and the chosen fit."""
    log, model = draw(benchmark, request.param)
    return log, model, fitting.choose_fit(fitting.fit_shapes(log.select(*AXES)))


def test_the_shape_is_chosen_and_most_intervals_hold_what_was_planted(fitted, benchmark):
    log, model, best = fitted
    assert type(best.model.shape) is type(model.shape)
    found = fitting.find_parameters(best, log.select(*AXES))
    covered = benchmark.list_covered(model, found)
    assert sum(covered) >= len(covered) - 1
    for one in found:
        planted = benchmark.find_parameter(model, one.name)
        reach = one.interval.high - one.interval.low
        assert abs(one.value - planted) < reach < 0.6 * planted, one.name
    assert all(check.holds for check in check_position(log, best))


def test_z_is_standard_normal_under_the_chosen_model(fitted):
    log, _, best = fitted
    for axis in best.find_z(log.select(*AXES)).T:
        assert stats.kstest(axis, "norm").pvalue > 1e-3


@pytest.mark.parametrize("candidate", fitting.CANDIDATES, ids=lambda one: one.kind)
@settings(deadline=None, max_examples=25)
@given(seed=st.integers(0, 2**32))
def test_density_and_z_are_those_of_the_product(candidate, seed):
    random = np.random.default_rng(seed)
    model = DisturbanceModel(0.03, 0.8, 0.05, 0.3, shape=SHAPES[candidate.kind])
    steps = 30
    true = random.uniform(-80.0, 80.0, (FEWEST_TRACKS, steps, 2))
    slopes, bases = np.array([0.03, 0.05]), np.array([0.8, 0.3])
    sigma = (slopes * np.abs(true) + bases).astype(np.float32)
    z = random.standard_normal(true.shape).astype(np.float32)
    noise = [NoiseTrajectory(a, b, model.shape) for a, b in zip(z, sigma, strict=True)]
    seen = true + np.stack([one.injected for one in noise])
    log = make_log(
        [
            Row(f"{track}", 0.1 * step, (*true[track, step], *seen[track, step]))
            for track in range(FEWEST_TRACKS)
            for step in range(steps)
        ],
        0.1,
    )
    errors, parameters = log.select(*AXES), list_parameters(model)
    density = np.bincount(errors.track, fitting.compute_density(candidate, errors, parameters))
    assert density == pytest.approx([one.log_probability for one in noise], rel=1e-4, abs=1e-2)
    u = errors.error / sigma.reshape(-1, 2)
    found = candidate.find_z(errors, u, parameters[4:])
    assert found == pytest.approx(z.reshape(-1, 2), abs=2e-3)


def test_every_misfit_is_found(benchmark):
    for name, bend in benchmark.BENDS.items():
        log, _ = draw(benchmark, "white", bend)
        failed = [
            one
            for one in check_position(
                log, fitting.choose_fit(fitting.fit_shapes(log.select(*AXES)))
            )
            if not one.holds
        ]
        assert failed, name


def see(track, step, is_seen=True, time_s=None):
    """A measurement of a vehicle that moves away in its own lane."""
    seen = (10.5 + step + 0.01 * track, 0.5 * track) if is_seen else (nan, nan)
    return Row(f"{track}", 0.1 * step if time_s is None else time_s, (10.0 + step, track, *seen))


def test_a_step_that_was_missed_breaks_the_correlation():
    rows = [
        see(track, step, is_seen=step != 2) for track in range(FEWEST_TRACKS) for step in range(5)
    ]
    log = make_log(rows, 0.1)
    errors = log.select(*AXES)
    assert errors.follows[:4].tolist() == [False, True, False, True]
    assert (log.is_missed.sum(), log.count_misses()) == (FEWEST_TRACKS, FEWEST_TRACKS)
    ar1 = next(one for one in fitting.CANDIDATES if one.kind == "ar1")
    u = np.tile([[1.0, 0.5]], (len(errors.track), 1))
    z = ar1.find_z(errors, u, np.array([0.6, 0.0]))[:4]
    assert z[:, 0] == pytest.approx([1.0, 0.5, 1.0, 0.5])
    assert z[:, 1] == pytest.approx([0.5] * 4)


def test_runs_of_misses_and_ghosts_are_counted():
    seen = [True, True, False, False, True, True, False]
    rows = [
        see(track, step, is_seen, time_s=track + 0.1 * step)
        for track in range(FEWEST_TRACKS)
        for step, is_seen in enumerate(seen)
    ]
    ghosts = [Row("g", 0.3, (nan, nan, 3.0, 0.0)), Row("h", 0.9, (nan, nan, 5.0, 0.0))]
    log = make_log([*rows, *ghosts], 0.1)
    assert (log.is_missed.sum(), log.count_misses()) == (3 * FEWEST_TRACKS, 2 * FEWEST_TRACKS)
    assert (log.ghosts.measurements, log.ghosts.apart) == (2, 1)
    assert len(log.select(*AXES).track) == 4 * FEWEST_TRACKS
    steps = log.list_miss_steps()
    assert steps.before[:6].tolist() == [False, False, True, True, False, False]
    assert steps.now[:6].tolist() == [False, True, True, False, False, True]
    assert steps.age[:6].tolist() == [0, 0, 1, 2, 1, 2]


@pytest.mark.parametrize(
    ("times", "text"),
    [
        ((0.0, 0.1, 0.25), "track 0 at 0.25 s is not a whole number of steps of 0.1 s"),
        ((0.0, 0.1, 0.1), "track 0 has two measurements at 0.1 s"),
        ((0.0, 0.04, 0.08), "track 0 at 0.04 s is not a whole number"),
        ((0.0, 100.0, 200.0), "only 0 % of the measurements come one step of 0.1 s after another"),
    ],
)
def test_times_that_are_not_of_the_step_are_refused(times, text):
    rows = [
        see(track, step, time_s=time_s)
        for track in range(FEWEST_TRACKS)
        for step, time_s in enumerate(times)
    ]
    with pytest.raises(InvalidValue, match=text):
        make_log(rows, 0.1)


def test_fewer_tracks_than_intervals_rest_on_are_refused():
    rows = [see(track, step) for track in range(FEWEST_TRACKS - 1) for step in range(2)]
    unseen = see(99, 0, is_seen=False)
    with pytest.raises(InvalidValue, match="29 tracks contain measurements of a vehicle; at least"):
        make_log([*rows, unseen], 0.1)


@pytest.mark.parametrize(("axis", "name"), [(0, "dx_m"), (1, "dy_m")])
def test_distances_that_do_not_differ_are_refused(axis, name):
    rows = []
    for track in range(FEWEST_TRACKS):
        for step in range(3):
            row = see(track, step)
            positions = list(row.positions)
            positions[axis] = 3.5
            rows.append(row._replace(positions=tuple(positions)))
    with pytest.raises(InvalidValue, match=rf"{name}: all distances are about 3.5 m"):
        make_log(rows, 0.1)


def test_distances_that_hardly_differ_give_a_wide_interval():
    random = np.random.default_rng(2)
    rows = [
        Row(f"{track}", 0.1 * step, (dx, dy, dx + random.normal(), dy + 0.2 * random.normal()))
        for track in range(FEWEST_TRACKS)
        for step in range(20)
        for dx, dy in [(20.0 + track + step, 3.5 + 0.12 * ((track + step) % 2) * (track == 0))]
    ]
    log = make_log(rows, 0.1)
    errors = log.select(*AXES)
    white = fitting.fit_shapes(errors)[0]
    found = {one.name: one.interval for one in fitting.find_parameters(white, errors)}
    assert found["lateral_slope"].low == 0.0
    assert found["lateral_slope"].high > 0.1


def test_a_perfect_sensor_is_refused():
    rows = [
        Row(f"{track}", 0.1 * step, (10.0 + step, track, 11.0 + step * step, track))
        for track in range(FEWEST_TRACKS)
        for step in range(4)
    ]
    with pytest.raises(InvalidValue, match=r"seen_dy_m: all errors are 0 m"):
        make_log(rows, 0.1)


def test_checks_of_short_logs_raise_no_false_alarms():
    """30 tracks of 10 steps: in most such logs no |z| is above 3."""
    alarms = 0
    white = fitting.CANDIDATES[0]
    for seed in range(60):
        random = np.random.default_rng(seed)
        rows = [
            Row(f"{track}", 0.1 * step, (dx, dy, dx + random.normal(), dy + random.normal()))
            for track in range(FEWEST_TRACKS)
            for step in range(10)
            for dx, dy in [(20.0 + 2.0 * track + step, 0.1 * track)]
        ]
        log = make_log(rows, 0.1)
        best = jackknife.maximize_likelihood(fitting.make_likelihood(white, log.select(*AXES)))
        fit = fitting.Fit(white, AXES, best, jackknife.ShapeScore(0.0, None))
        alarms += any(not one.holds for one in check_position(log, fit))
    assert alarms <= 4


def test_the_interval_of_a_mean_over_equal_tracks_is_students(benchmark):
    values = np.random.default_rng(3).normal(2.0, 1.0, 40)
    mean, interval = jackknife.find_ratio_interval(values, np.ones(40))
    expected = stats.t.interval(0.95, 39, values.mean(), stats.sem(values))
    assert mean == pytest.approx(values.mean())
    assert (interval.low, interval.high) == pytest.approx(expected)


HEAD = "track,time_s,dx_m,dy_m,seen_dx_m,seen_dy_m"


@pytest.mark.parametrize(
    ("text", "problem"),
    [
        ("track,time_s,dx_m\n", "columns dy_m, seen_dx_m, seen_dy_m are missing; its columns are"),
        (f"{HEAD}\n1,0.0,ten,0,10,0\n", r"log.csv, row 2: dx_m: 'ten' is not a finite number"),
        (f"{HEAD}\n1,0.0,inf,0,10,0\n", "'inf' is not a finite number"),
        (f"{HEAD}\n1,,10,0,10,0\n", "row 2: time_s: is empty"),
        (f"{HEAD}\n\n,0.0,10,0,10,0\n", "row 3: track: is empty"),
        (f"{HEAD}\n1,0.0,10,0,10,\n", "row 2: only one of seen_dx_m and seen_dy_m is given"),
        (f"{HEAD}\n1,0.0,10\n", "row 2: only one of dx_m and dy_m"),
        ("", "are missing; it has none"),
        (f"{HEAD}\n", "log.csv: contains no rows"),
        (f"{HEAD}\n".replace(",", ";"), "log.csv: contains no rows"),
        (f"{HEAD}\n".replace(",", ":"), "its columns are track:time_s:dx_m"),
        (f"{HEAD},heading\n", "column heading is not read, and column heading_rad is missing"),
        (
            f"{HEAD},heading_rad,seen_heading_rad\n1,0.0,10,0,10,0,179.2,181\n",
            "row 2: heading_rad: 179.2 is beyond a turn, 2π. The headings seem to be in degrees",
        ),
        (
            f"{HEAD},heading_rad,seen_heading_rad\n1,0.0,10,0,10,0,0.1,-999\n",
            "row 2: seen_heading_rad: -999 is beyond a turn, 2π. It seems to mean that there is no",
        ),
        (f"{HEAD},speed_mps\n", "column speed_mps is given, and column seen_speed_mps is missing"),
        (
            f"{HEAD},speed_mps,seen_speed_mps\n1,0.0,10,0,,,20,21\n",
            "row 2: seen_speed_mps: is given, and seen_dx_m is empty",
        ),
    ],
)
def test_a_table_that_is_no_log_is_refused_with_the_place(tmp_path, text, problem):
    file = tmp_path / "log.csv"
    file.write_text(text)
    with pytest.raises(InvalidValue, match=problem):
        read_log(file, 0.1)


@pytest.mark.parametrize("name", ["absent.csv", "absent.parquet", "garbage.csv", "garbage.parquet"])
def test_a_file_that_cannot_be_read_is_refused(tmp_path, name):
    if name.startswith("garbage"):
        (tmp_path / name).write_bytes(b"\xff\xfe\x00garbage")
    with pytest.raises(InvalidValue, match=rf"{name}: cannot be read"):
        read_log(tmp_path / name, 0.1)


def test_csv_and_parquet_and_csv_of_excel_hold_the_same(tmp_path):
    import pandas as pd

    table = pd.DataFrame(
        {
            "track": np.repeat(np.arange(FEWEST_TRACKS), 3),
            "time_s": np.tile([0.0, 0.1, 0.2], FEWEST_TRACKS),
            "dx_m": np.linspace(10.0, 50.0, 3 * FEWEST_TRACKS),
            "dy_m": np.tile([0.0, 1.0, 2.0], FEWEST_TRACKS),
            "seen_dx_m": np.tile([10.5, 11.0, nan], FEWEST_TRACKS),
            "seen_dy_m": np.tile([0.5, 0.0, nan], FEWEST_TRACKS),
            "speed_mps": 20.0,
            "seen_speed_mps": np.tile([20.5, 21.0, nan], FEWEST_TRACKS),
            "sensor": "front",
        }
    )
    table.to_csv(tmp_path / "log.csv", index=False)
    table.to_parquet(tmp_path / "log.parquet")
    text = (tmp_path / "log.csv").read_text()
    excel = "\ufeff" + text.replace(",", ";").replace("track", "Track ")
    (tmp_path / "excel.csv").write_text(excel, encoding="utf-8")
    files = ("log.csv", "log.parquet", "excel.csv")
    logs = [read_log(tmp_path / file, 0.1) for file in files]
    assert all(log.unread == ("sensor",) for log in logs)
    assert logs[0].channels == ("longitudinal", "lateral", "speed")
    for one, other in pairwise(logs):
        for field in msgspec.structs.fields(one):
            if field.name != "ghosts":
                np.testing.assert_array_equal(getattr(one, field.name), getattr(other, field.name))


def test_conversion_of_the_planted_model_is_that_of_episodes(benchmark):
    model = DisturbanceModel(0.0, 2.0, 0.0, 0.5, shape=Correlated(0.9, 0.2))
    true = np.zeros((5, 2))
    errors = benchmark.draw_errors(model, true, np.random.default_rng(1))
    z = np.random.default_rng(1).standard_normal((5, 2))
    conversion = Conversion(model.shape)
    expected = [conversion.inject(tuple(one), (2.0, 0.5)) for one in z]
    np.testing.assert_allclose(errors, expected)
