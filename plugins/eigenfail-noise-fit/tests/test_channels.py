"""Misses and ghosts are fitted as Markov chains, and further quantities as channels."""

from itertools import pairwise
from math import nan, pi

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eigenfail.errors import InvalidValue
from eigenfail.values.disturbance import AXES, NoiseTrajectory
from eigenfail.values.shapes import Markov, PerChannel
from eigenfail_noise_fit import events, sensor_log
from eigenfail_noise_fit.checks import check_channels
from eigenfail_noise_fit.fitting import choose_fit, fit_shapes
from eigenfail_noise_fit.report import fit_log


def join(courses, distances_m):
    """Steps of courses of an event, each in a block of its own."""
    ages = []
    for course in courses:
        age = [0]
        for before, now in pairwise(course):
            age.append(1 if now != before else age[-1] + bool(age[-1]))
        ages.append(age[:-1])
    return sensor_log.EventSteps(
        block=np.repeat(np.arange(len(courses)), [len(course) - 1 for course in courses]),
        before=np.concatenate([course[:-1] for course in courses]).astype(bool),
        now=np.concatenate([course[1:] for course in courses]).astype(bool),
        age=np.concatenate(ages).astype(np.int64),
        distance_m=np.concatenate([one[1:] for one in distances_m]),
        blocks=len(courses),
    )


def draw_steps(benchmark, shape, tracks=80, steps=100):
    random = np.random.default_rng(7)
    distances = [random.uniform(5.0, 90.0) + 0.1 * np.arange(steps) for _ in range(tracks)]
    return join([benchmark.draw_chain(shape, one, random) for one in distances], distances)


def fit(steps, name="missed"):
    return events.choose_chain(events.fit_chains(name, steps, by_distance=name == "missed"))


def test_a_constant_rate_is_begun_over_absent_and_a_duration_lasting_over_ended():
    courses = [[0, 1, 1, 0, 0, 1, 0, 0], [0, 0, 0, 0, 1, 1, 1, 0], [1, 1, 0, 0, 0, 0, 0, 1]]
    steps = join(10 * courses, 30 * [np.linspace(10.0, 50.0, 8)])
    (chain,) = events.fit_chains("ghost", steps, by_distance=False)
    # Of 13 steps after an absent one 4 begin; of 8 after a lasting one 4 end.
    assert chain.shape.rate == pytest.approx(4 / 13, rel=1e-4)
    assert chain.shape.mean_steps == pytest.approx(8 / 4, rel=1e-4)
    rate, duration = events.find_chain_parameters(chain, steps)
    assert rate.interval.low < 4 / 13 < rate.interval.high < 0.5
    assert 1.0 <= duration.interval.low < 2.0 < duration.interval.high


@pytest.mark.parametrize(
    ("shape", "kind"),
    [(Markov(0.02, 4.0), events.CONSTANT), (Markov(0.005, 3.0, 0.0008), events.GROWING)],
)
def test_whether_the_rate_grows_is_chosen_and_the_planted_chain_found(benchmark, shape, kind):
    steps = draw_steps(benchmark, shape)
    chain = fit(steps)
    assert chain.kind == kind
    for one in events.find_chain_parameters(chain, steps):
        planted = getattr(shape, one.name.removeprefix("missed."))
        assert one.interval.low <= planted <= one.interval.high, one.name
    assert all(one.holds for one in check(chain, steps))


def check(chain, steps):
    """The checks of a chain alone."""
    return check_channels(None, (), [(chain, steps)])


@settings(deadline=None, max_examples=25)
@given(seed=st.integers(0, 2**32), growth=st.sampled_from([0.0, 0.002]))
def test_the_likelihood_of_a_chain_is_that_of_the_product(benchmark, seed, growth):
    random = np.random.default_rng(seed)
    shape = Markov(0.05, 3.0, growth) if growth else Markov(0.05, 3.0)
    distance = np.linspace(60.0, 20.0, 40)
    z = random.standard_normal((40, 1)).astype(np.float32)
    sigma = (shape.rate + growth * distance)[:, None].astype(np.float32)
    noise = NoiseTrajectory(z, sigma if growth else np.ones_like(sigma), PerChannel((shape,)))
    course = noise.injected[:, 0] > 0.5
    steps = join([course], [distance])
    name = "missed"
    chain = events.fit_chains(
        name, draw_steps(benchmark, Markov(0.05, 3.0), 30, 30), by_distance=True
    )[1]
    exact = type(chain)(events.GROWING, name, np.array([0.05, 1.0 / 3.0, growth]), chain.score)
    p = exact.compute_probability(steps)
    found = np.log(np.where(steps.now, p, 1.0 - p))
    assert found == pytest.approx(noise.log_probability_per_step[1:], rel=1e-4, abs=1e-5)


def test_runs_of_one_length_are_not_geometric():
    random = np.random.default_rng(1)
    course = [np.resize(np.roll([0] * 20 + [1] * 4, random.integers(24)), 120) for _ in range(60)]
    steps = join(course, [np.linspace(20.0, 60.0, 120)] * 60)
    failed = {one.name for one in check(fit(steps), steps) if not one.holds}
    assert "missed: share of runs that end after its first step" in failed


def test_misses_that_are_rarer_far_away_fail_a_check(benchmark):
    random = np.random.default_rng(2)
    distances = [random.uniform(5.0, 90.0) + 0.1 * np.arange(100) for _ in range(80)]
    near = [np.where(one < 40.0, 45.0, 0.0) for one in distances]
    courses = [benchmark.draw_chain(Markov(0.004, 2.0, 0.002), one, random) for one in near]
    steps = join(courses, distances)
    failed = {one.name for one in check(fit(steps), steps) if not one.holds}
    assert "missed: share of steps at which an event begins, farthest third" in failed
    shares = [band.share for band in events.list_bands(steps)]
    assert shares[0] > 3.0 * shares[-1]


def test_misses_that_never_end_are_refused():
    courses = [[0] * 10 + [1] * 5 for _ in range(40)]
    steps = join(courses, [np.linspace(20.0, 60.0, 15)] * 40)
    with pytest.raises(InvalidValue, match="no run of 'missed' ends between two steps"):
        fit(steps)


def see(track, step, others=(), time_s=None, missed=False):
    """A measurement of a vehicle, with errors of one metre and less."""
    random = np.random.default_rng([track, step])
    dx, dy = 10.0 + track + step, 0.1 * track
    seen = (nan, nan) if missed else (dx + random.normal(), dy + 0.2 * random.normal())
    time_s = 0.1 * step + track if time_s is None else time_s
    return sensor_log.Row(f"{track}", time_s, (dx, dy, *seen), others)


def test_a_heading_error_is_the_smaller_turn():
    rows = [
        see(track, step, (pi - 0.01, -pi + 0.001 * track))
        for track in range(sensor_log.FEWEST_TRACKS)
        for step in range(3)
    ]
    errors = sensor_log.make_log(rows, 0.1, ("heading",)).select("heading")
    assert errors.error[::3, 0] == pytest.approx(0.01 + 0.001 * np.arange(sensor_log.FEWEST_TRACKS))
    assert errors.distance_m[4, 0] == pytest.approx(np.hypot(12.0, 0.1))


def test_a_value_that_was_not_measured_breaks_the_correlation_of_its_channel_alone():
    rows = [
        see(track, step, (20.0, nan if step == 2 else 20.5 + 0.01 * track))
        for track in range(sensor_log.FEWEST_TRACKS)
        for step in range(5)
    ]
    log = sensor_log.make_log(rows, 0.1, ("speed",))
    assert log.select("speed").follows[:4].tolist() == [False, True, False, True]
    assert log.select(*AXES).follows[:5].tolist() == [False, True, True, True, True]


@pytest.mark.parametrize(
    ("seen", "problem"),
    [
        (lambda track: 20.5 if track < 29 else nan, "29 tracks contain it next to the true value"),
        (lambda _track: 20.5, "seen_speed_mps: all errors are 0.5 m/s"),
    ],
)
def test_a_quantity_that_says_too_little_is_refused(seen, problem):
    rows = [
        see(track, step, (20.0, seen(track)))
        for track in range(sensor_log.FEWEST_TRACKS)
        for step in range(3)
    ]
    with pytest.raises(InvalidValue, match=problem):
        sensor_log.make_log(rows, 0.1, ("speed",))


def test_ghosts_are_counted_at_the_times_of_vehicles():
    rows = [see(track, step) for track in range(sensor_log.FEWEST_TRACKS) for step in range(10)]
    ghosts = [
        sensor_log.Row(name, time_s, (nan, nan, dx, 3.0))
        for name, time_s, dx in [
            ("a", 0.2, 30.0),
            ("a", 0.3, 29.0),
            ("b", 5.4, 50.0),
            ("behind", 7.1, -5.0),
        ]
    ]
    found = sensor_log.make_log([*rows, *ghosts], 0.1).ghosts
    assert found.first.tolist() == [[30.0, 3.0], [50.0, 3.0]]
    assert (found.measurements, found.behind, found.apart) == (4, 1, 0)
    steps = found.steps
    # All 300 times follow one another; two begin after 297 without a ghost, two of three end.
    assert (len(steps.now), (~steps.before & steps.now).sum()) == (299, 2)
    assert ((steps.before).sum(), (steps.before & ~steps.now).sum()) == (3, 2)


def test_ghosts_without_a_common_clock_are_refused():
    rows = [
        see(track, step, time_s=0.1 * step)
        for track in range(sensor_log.FEWEST_TRACKS)
        for step in (0, 1)
    ]
    with pytest.raises(InvalidValue, match="all tracks begin at the same time"):
        sensor_log.make_log([*rows, sensor_log.Row("g", 0.1, (nan, nan, 5.0, 0.0))], 0.1)


def test_a_position_alone_keeps_its_form_and_a_miss_makes_channels():
    def fit_model(missed):
        rows = [
            see(track, step, missed=(track + step) % 10 in missed)
            for track in range(sensor_log.FEWEST_TRACKS)
            for step in range(12)
        ]
        return fit_log(sensor_log.make_log(rows, 0.1))[1].model

    assert fit_model(set()).list_channels()[0].name == "longitudinal"
    assert not hasattr(fit_model(set()).channels, "__len__")
    names = [channel.name for channel in fit_model({4, 5}).channels]
    assert names == ["longitudinal", "lateral", "missed"]


def test_a_fitted_probability_of_failure_lies_within_the_interval_of_the_planted_model(benchmark):
    random = np.random.default_rng(3)
    planted = benchmark.draw_channels(random, 1)
    log = benchmark.draw_channel_log(planted, random)
    steps = log.list_miss_steps()
    fitted = {
        "longitudinal": choose_fit(fit_shapes(log.select("longitudinal"))).channel,
        "missed": planted["missed"].__class__("missed", shape=fit(steps).shape),
    }
    limit_m = benchmark.TOY_SIGMAS * benchmark.find_sigma(planted["longitudinal"])
    interval = benchmark.simulate_toy(planted, limit_m, random)
    for channels in (planted, fitted):
        assert interval.low < benchmark.compute_toy(channels, limit_m) < interval.high
