"""The failing region: planted ones are found, chance is not mistaken for one."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from eigenfail_failing_region.boxes import (
    SIGNIFICANCE,
    RegionQuestion,
    describe_bound,
    find_failing_region,
    split_in_halves,
)

NAMES = ("distance_m", "ego_speed_mps")


def question(values, failed, names=NAMES) -> RegionQuestion:
    return RegionQuestion((1,), "cut_in", names, values, np.asarray(failed, np.bool_))


def uniform(seed: int, episodes: int):
    """Distances from 52 to 70 m, speeds from 22 to 25 m/s."""
    random = np.random.default_rng(seed)
    return random, random.uniform([52.0, 22.0], [70.0, 25.0], (episodes, 2))


@pytest.mark.parametrize("seed", range(5))
def test_a_planted_corner_is_found_with_its_bounds(seed: int) -> None:
    random, values = uniform(seed, 2000)
    corner = (values[:, 0] <= 56.0) & (values[:, 1] > 24.0)
    found = find_failing_region(question(values, random.random(2000) < np.where(corner, 0.8, 0.01)))
    box = found.boxes[0]
    bounds = {each.parameter: each for each in box.bounds}
    assert bounds["distance_m"].low is bounds["ego_speed_mps"].high is None
    assert bounds["distance_m"].high == pytest.approx(56.0, abs=0.5)
    assert bounds["ego_speed_mps"].low == pytest.approx(24.0, abs=0.2)
    assert box.precision.interval.low <= 0.8 <= box.precision.interval.high + 0.05
    assert box.coverage.value > 0.65
    assert found.p_value < 1e-12
    assert found.problem == ""


def test_a_region_of_one_cut_by_hand() -> None:
    """Below 60 all fail, above it none: one box, exact in every figure."""
    values = np.repeat([50.0, 70.0], 50)[:, None]
    found = find_failing_region(question(values, values[:, 0] < 60.0, ("distance_m",)))
    (box,) = found.boxes
    assert box.words == "distance at most 50 m"
    assert (box.bounds[0].low, box.bounds[0].high, box.bounds[0].unit) == (None, 50.0, "m")
    assert (box.coverage.k, box.coverage.n) == (25, 25)
    assert (box.precision.k, box.precision.n) == (25, 25)
    assert (found.failure_rate.k, found.failure_rate.n) == (25, 50)
    # Fisher's exact test: one way of C(50, 25).
    assert found.p_value == pytest.approx(7.911e-15, rel=1e-3)


def test_two_far_corners_are_two_boxes() -> None:
    random, values = uniform(1, 4000)
    failed = (values[:, 0] < 55.0) | (values[:, 0] > 67.0)
    found = find_failing_region(question(values, failed & (random.random(4000) < 0.9)))
    assert len(found.boxes) == 2
    assert sorted(box.words.split(" ")[2] for box in found.boxes) == ["least", "most"]
    assert found.coverage.k == sum(box.coverage.k for box in found.boxes)
    assert found.precision.n == sum(box.precision.n for box in found.boxes)


def test_chance_alone_is_seldom_taken_for_a_region() -> None:
    taken = 0
    for seed in range(60):
        random, values = uniform(100 + seed, 400)
        taken += bool(find_failing_region(question(values, random.random(400) < 0.2)).boxes)
    assert taken <= 3  # 0.6 expected; more than 3 in 3 of 1000 tries


def test_chance_is_given_as_the_reason() -> None:
    random, values = uniform(0, 400)
    found = find_failing_region(question(values, random.random(400) < 0.2))
    assert found.boxes == ()
    assert found.p_value is found.coverage is None
    assert "No part fails more often" in found.problem
    assert found.failure_rate.n == 400


@pytest.mark.parametrize(("failures", "episodes"), [(19, 100), (81, 100), (0, 50), (0, 0)])
def test_too_few_of_either_kind_are_refused(failures: int, episodes: int) -> None:
    _, values = uniform(0, episodes)
    found = find_failing_region(question(values, np.arange(episodes) < failures))
    assert found.boxes == ()
    assert f"{failures} of {episodes} episodes failed: it takes 20" in found.problem


def test_nothing_that_varies_is_refused() -> None:
    found = find_failing_region(question(np.zeros((100, 0)), np.arange(100) < 50, ()))
    assert "No scenario parameter took more than one value" in found.problem


def test_it_is_the_same_whenever_it_is_repeated() -> None:
    random, values = uniform(2, 600)
    asked = question(values, random.random(600) < np.where(values[:, 0] < 57.0, 0.6, 0.1))
    assert find_failing_region(asked) == find_failing_region(asked)


@given(st.lists(st.booleans(), min_size=2, max_size=200))
def test_halves_share_the_failures(failed: list[bool]) -> None:
    flags = np.array(failed)
    grown, held = split_in_halves(flags)
    assert sorted([*grown, *held]) == list(range(len(failed)))
    assert 0 <= int(flags[grown].sum()) - int(flags[held].sum()) <= 1


@settings(max_examples=25)
@given(st.integers(0, 10_000), st.floats(0.05, 0.95), st.floats(0.0, 1.0))
def test_figures_agree_with_each_other(seed: int, inside: float, outside: float) -> None:
    random, values = uniform(seed, 300)
    failed = random.random(300) < np.where(values[:, 0] < 58.0, inside, outside)
    found = find_failing_region(question(values, failed))
    assert bool(found.problem) == (not found.boxes)
    if found.boxes:
        assert found.p_value <= SIGNIFICANCE
        assert found.coverage.k == found.precision.k == sum(b.coverage.k for b in found.boxes)
        assert found.coverage.n == found.failure_rate.k
        assert found.precision.value > found.failure_rate.value
        shares = [box.coverage.k for box in found.boxes]
        assert shares == sorted(shares, reverse=True)


@pytest.mark.parametrize(
    ("name", "low", "high", "words"),
    [
        ("distance_m", None, 56.25, "distance at most 56.25 m"),
        ("ego_speed_mps", 23.0, None, "ego speed at least 23 m/s"),
        ("deceleration_mps2", 3.0, 3.5, "deceleration 3 to 3.5 m/s²"),
        ("gap_s", 4.0, 4.0, "gap 4 s"),
        ("cars", 2.0, None, "cars at least 2"),
        ("lane_count", None, 3.0, "lane count at most 3"),
    ],
)
def test_bounds_in_words(name: str, low, high, words: str) -> None:
    assert describe_bound(name, low, high).words == words
