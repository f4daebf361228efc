"""When noise matters: by hand, and in failures whose deciding moment is known."""

from collections.abc import Callable
from typing import Any

import msgspec
import numpy as np
import pytest

from eigenfail.values.analysis import AnalysisSettings
from eigenfail.values.records import Failures
from eigenfail_services.analysis.alignment import (
    FailureBatch,
    find_moments,
    find_peaks,
    gather_failures,
    measure_before_collision,
)
from eigenfail_services.analysis.job import analyse_gathered

STEP_S = 0.1


def test_peaks_are_apart_and_the_largest_come_first() -> None:
    course = np.zeros(30)
    course[[4, 5, 6, 20, 28, 0]] = [3.0, 9.0, 4.0, 7.0, 1.0, 2.0]
    assert find_peaks(course.tolist()) == [5, 20, 0]
    assert find_peaks([0.0] * 5) == []
    assert find_peaks([1.0, 1.0]) == [0]


def test_the_share_of_the_last_second_by_hand() -> None:
    influence = np.zeros((100, 2), np.float32)
    influence[60:, 0] = 1.0
    influence[90:, 1] = 2.0
    influence[:60] = 50.0  # Before half of the failures had begun.
    one, two = measure_before_collision(influence, 40, STEP_S)
    assert (one.seconds, one.time) == (1.0, 0.25)
    assert (one.longitudinal, one.lateral) == (0.25, 1.0)
    assert one.both == pytest.approx((10 + 20) / (40 + 20))
    assert (two.seconds, two.time, two.longitudinal) == (2.0, 0.5, 0.5)


@pytest.mark.parametrize("count", [1, 3, 5])
def test_each_channel_has_its_share_by_hand(count: int) -> None:
    influence = np.zeros((40, count), np.float32)
    influence[:, 0] = 1.0
    influence[30:, 1:] = 2.0
    channels = ("gust", "drift", "bias", "glare", "delay")[:count]
    one, _ = measure_before_collision(influence, 40, STEP_S, channels)
    assert (one.longitudinal, one.lateral) == (None, None)
    assert one.channels == one.by_channel == (0.25, 1.0, 1.0, 1.0, 1.0)[:count]
    assert one.both == pytest.approx((10 + 20 * (count - 1)) / (40 + 20 * (count - 1)))


def test_the_shares_of_a_road_have_their_two_fields_alone() -> None:
    (one, _) = measure_before_collision(np.ones((40, 2), np.float32), 40, STEP_S)
    assert one.by_channel == (0.25, 0.25)
    assert {*msgspec.to_builtins(one)} == {"seconds", "time", "longitudinal", "lateral", "both"}


def test_without_times_influence_or_as_long_a_failure_no_share_is_told() -> None:
    nothing = np.zeros((100, 2), np.float32)
    assert measure_before_collision(nothing, 40, None) == ()
    assert [each.both for each in measure_before_collision(nothing, 40, STEP_S)] == [None, None]
    assert [each.seconds for each in measure_before_collision(nothing, 15, STEP_S)] == [1.0]


@pytest.mark.parametrize(("align", "step"), [("start", 55), ("collision", 95)])
def test_a_moment_is_named_in_time_before_the_collision(align: Any, step: int) -> None:
    """Half of the failures last 60 steps: 5 of them are 0.5 s."""
    noise = [np.zeros((steps, 2), np.float32) for steps in (50, 60, 60)]
    given = Failures((0, 1, 2), tuple(noise))
    aligned = gather_failures([FailureBatch(1, given)], 100, AnalysisSettings(align=align))
    influence = np.zeros((100, 2), np.float32)
    influence[step, 1] = 2.0
    influence[80, 0] = 3.0 if align == "start" else 0.0  # After the collision of most.
    (found,) = find_moments(influence, aligned, STEP_S)
    assert (found.axis, found.step, found.influence) == ("lateral", step, 2.0)
    assert found.before_collision_s == pytest.approx(0.5)
    assert find_moments(influence, aligned, None)[0].before_collision_s is None


@pytest.mark.parametrize("align", ["start", "collision"])
def test_what_decides_in_the_last_second_is_found_there(align: Any) -> None:
    generator = np.random.default_rng(1)
    noise = []
    for steps in generator.integers(60, 101, 120).tolist():
        z = 0.3 * generator.standard_normal((steps, 2)).astype(np.float32)
        z[-8:, 0] += 2.0 * generator.choice([-1.0, 1.0])
        noise.append(z)
    given = FailureBatch(1, Failures(tuple(range(120)), tuple(noise)))
    asked = AnalysisSettings(align=align, components=1, bootstrap=0)
    found = analyse_gathered(gather_failures([given], 100, asked), asked, STEP_S, {1: 120})
    assert found.before_collision[0].longitudinal > 0.8
    assert found.before_collision[0].time < 0.15
    if align == "collision":
        first = next(each for each in found.moments if each.axis == "longitudinal")
        assert first.before_collision_s < 0.9


def test_noise_without_a_deciding_moment_has_its_share_of_the_time(
    failures_of: Callable[..., Failures],
) -> None:
    noise = list(np.random.default_rng(2).standard_normal((300, 100, 2)))
    asked = AnalysisSettings(components=50, bootstrap=0, clusters=1)
    portion = FailureBatch(1, failures_of(noise))
    found = analyse_gathered(gather_failures([portion], 100, asked), asked, STEP_S, {})
    for each in found.before_collision:
        assert each.both == pytest.approx(each.time, rel=0.15)
