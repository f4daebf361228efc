"""Adaptive multilevel splitting on a walk whose probability is known."""

from math import inf, sqrt

import numpy as np
import pytest
from scipy.stats import norm

from eigenfail_services.statistics.multilevel_splitting import (
    SplittingCounts,
    SplittingRun,
    make_course,
    pool_runs,
)

STEPS, WALL = 12, 11.0


def exceed_wall() -> float:
    """Return P(a walk of standard normal steps exceeds the wall), by quadrature on a grid."""
    grid, width = np.linspace(-30.0, WALL, 4101, retstep=True)
    inside = norm.pdf(grid)
    kernel = norm.pdf(grid[:, None] - grid[None, :]) * width
    for _ in range(STEPS - 1):
        inside = kernel @ inside
    return 1.0 - float(np.trapezoid(inside, dx=width))


P = exceed_wall()


def walk(z):
    """Return the importance after each step, and whether the walk exceeded the wall."""
    y = np.cumsum(z[:, :, 0].astype(np.float64), axis=1)
    beyond = y > WALL
    failed = beyond.any(axis=1)
    last = np.where(failed, beyond.argmax(axis=1), STEPS - 1)
    return [row[: end + 1].astype(np.float32) for row, end in zip(y, last, strict=True)], failed


def finish(run, importance=lambda y: y):
    while run.wave is not None:
        courses, failed = walk(run.wave.z)
        run.add([importance(y) for y in courses], failed.tolist())
    return run


def estimate(seed, n=40, given_up=0.1, importance=lambda y: y, channels=2):
    return finish(SplittingRun((seed,), (n, STEPS, channels), given_up), importance).probability


def expect_mean(found, truth):
    """By chance the mean misses by 3.5 of its deviations once in 2000 tests."""
    deviation = np.std(found, ddof=1) / sqrt(len(found))
    assert abs(np.mean(found) - truth) < 3.5 * deviation
    assert deviation < 0.15 * truth


@pytest.mark.parametrize(("given_up", "channels"), [(0.05, 2), (0.1, 5), (0.4, 1)])
def test_it_is_unbiased_whatever_share_is_given_up_with_any_number_of_channels(given_up, channels):
    expect_mean([estimate(seed, 40, given_up, channels=channels) for seed in range(120)], P)


def test_it_is_unbiased_with_an_importance_of_few_values_whose_ties_kill_runs():
    found = [estimate(seed, importance=lambda y: np.floor(y / 3.0)) for seed in range(400)]
    assert 0.0 in found
    expect_mean(found, P)


def test_it_is_unbiased_with_an_importance_that_says_little():
    found = [
        estimate(seed, 80, importance=lambda y: y + 3.0 * np.sin(2.0 * np.arange(len(y))))
        for seed in range(120)
    ]
    expect_mean(found, P)


def test_continuations_have_the_noise_of_another_one_until_it_exceeded_the_level():
    run = SplittingRun((5,), (30, STEPS, 2), 0.1)
    courses, failed = walk(run.wave.z)
    run.add(courses, failed.tolist())
    before, wave = run.z.copy(), run.wave
    for z in wave.z:
        common = [int((np.cumprod((z == other).all(axis=1))).sum()) for other in before]
        parent = int(np.argmax(common))
        steps = common[parent]
        assert parent not in wave.rows
        assert run.courses[parent, steps - 1] > wave.level
        assert steps == 1 or run.courses[parent, steps - 2] <= wave.level


def test_a_run_goes_on_bit_for_bit_from_its_state():
    whole, half = SplittingRun((3,), (30, STEPS, 2), 0.1), SplittingRun((3,), (30, STEPS, 2), 0.1)
    for _ in range(4):
        courses, failed = walk(half.wave.z)
        half.add(courses, failed.tolist())
    other = SplittingRun((3,), (30, STEPS, 2), 0.1)
    other.restore(half.z.copy(), half.courses.copy(), half.families.copy(), half.counts)
    assert finish(other).probability == finish(whole).probability
    assert np.array_equal(other.z, whole.z)
    assert np.array_equal(other.families, whole.families)
    assert len(set(whole.families.tolist())) < 30


def test_errored_episodes_come_no_closer():
    """With a tenth of the first draws lost, P is that of the rest times nine tenths."""
    found = []
    for seed in range(120):
        run, first = SplittingRun((seed,), (40, STEPS, 2), 0.1), True
        while run.wave is not None:
            courses, failed = walk(run.wave.z)
            if first:
                courses[:4], failed[:4] = [None] * 4, False
            first = False
            run.add(courses, failed.tolist())
        assert run.counts.unfaithful == 0
        found.append(run.probability)
    expect_mean(found, 0.9 * P)


def test_a_simulation_that_does_not_repeat_itself_is_noticed():
    run, random = SplittingRun((3,), (30, STEPS, 2), 0.1), np.random.default_rng(0)
    for _ in range(3):
        courses, failed = walk(random.standard_normal(run.wave.z.shape))
        run.add(courses, failed.tolist())
    assert run.counts.unfaithful > 0


def test_where_all_are_equal_the_run_dies_out():
    run = SplittingRun((3,), (30, STEPS, 2), 0.1)
    run.add([np.zeros(STEPS, np.float32)] * 30, [False] * 30)
    assert (run.wave, run.probability) == (None, 0.0)
    assert run.divide_by_families().tolist() == [0.0] * 30


def test_where_nearly_all_fail_the_first_draws_are_the_estimate():
    run = SplittingRun((3,), (30, STEPS, 2), 0.1)
    run.add([np.arange(3, dtype=np.float32)] * 30, [False] + [True] * 29)
    assert (run.wave, run.probability) == (None, pytest.approx(29 / 30))
    assert run.counts == SplittingCounts(waves=1)


def test_an_ended_run_takes_no_more():
    run = finish(SplittingRun((3,), (30, STEPS, 2), 0.1))
    with pytest.raises(ValueError, match="has ended"):
        run.add([], [])


def test_courses_are_running_maxima_and_infinite_from_the_collision_on():
    importance = np.array([1.0, 3.0, 2.0], np.float32)
    assert make_course(importance, False, 5).tolist() == [1.0, 3.0, 3.0, 3.0, 3.0]
    assert make_course(importance, True, 5).tolist() == [1.0, 3.0, inf, inf, inf]


def test_what_is_no_number_is_no_importance():
    strange = np.array([np.nan, 1.0, np.inf, np.nan], np.float32)
    course = make_course(strange, False, 5)
    assert course[0] == -inf
    assert course[1] == 1.0
    assert np.isfinite(course[2:]).all()
    assert course[2] > 1e30


def test_families_are_the_first_episodes_whose_first_noise_an_episode_still_has():
    run = SplittingRun((8,), (30, STEPS, 2), 0.1)
    first = run.wave.z.copy()
    finish(run)
    for row, family in enumerate(run.families.tolist()):
        assert np.array_equal(run.z[row, 0], first[family, 0])


def test_parts_of_the_families_sum_up_to_the_estimate():
    run = SplittingRun((8,), (30, STEPS, 2), 0.1)
    assert run.divide_by_families() is None
    parts = finish(run).divide_by_families()
    failed = np.isinf(run.courses[:, -1])
    assert parts.sum() == pytest.approx(run.probability)
    assert set(np.flatnonzero(parts).tolist()) == set(run.families[failed].tolist())


def test_the_error_of_a_mean_has_the_families_and_the_differences_of_the_runs():
    """Parts 0.5 and 0.5, 2, 3, and none: (6)² ÷ (0.25 + 0.25 + 4 + 9) families."""
    parts = [np.array(one) for one in ([0.5, 0.5], [2.0, 0.0], [0.0, 3.0], [0.0, 0.0])]
    pooled = pool_runs(parts)
    apart = np.std([1.0, 2.0, 3.0, 0.0], ddof=1) / 2.0 / 1.5
    assert pooled.probability == 1.5
    assert pooled.families == pytest.approx(36.0 / 13.5)
    assert pooled.cv == pytest.approx(sqrt(apart**2 + 13.5 / 36.0))
    assert pooled.reached == 3


def test_equal_runs_of_one_family_each_are_not_sure():
    """The runs agree, but each has a single family: the error is that of as many draws."""
    pooled = pool_runs([np.array([1.0, 0.0])] * 4)
    assert (pooled.families, pooled.cv) == (4.0, 0.5)


def test_runs_without_failures_have_no_error():
    assert pool_runs([np.zeros(3), np.zeros(3)]) == (0.0, inf, 0.0, 0)
