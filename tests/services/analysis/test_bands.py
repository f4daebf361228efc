"""The band about an eigenfailure: how the noise of its failures spreads at each step."""

import numpy as np
import pytest
from msgspec.structs import replace

from eigenfail.values.analysis import AnalysisSettings
from eigenfail.values.records import Failures
from eigenfail_services.analysis.job import analyse, hash_result

HORIZON = 12


def bands(lengths, align):
    """Of failures whose noise at each step is their own number, all in one mode."""
    noise = tuple(np.full((steps, 2), n, np.float32) for n, steps in enumerate(lengths))
    failures = Failures(tuple(range(len(lengths))), noise)
    settings = AnalysisSettings(align=align, clusters=1, bootstrap=0)
    (mode,) = analyse(failures, HORIZON, settings).modes
    assert mode.band.shape == (2, HORIZON, 2)
    assert mode.band.dtype == np.float32
    return mode.band


def test_at_each_step_it_is_of_the_failures_that_lasted_so_long():
    low, high = bands([10] * 10 + [4], "start")
    assert low[:4] == pytest.approx(np.quantile(np.arange(11.0), 0.1) * np.ones((4, 2)))
    assert high[:4] == pytest.approx(np.quantile(np.arange(11.0), 0.9) * np.ones((4, 2)))
    assert high[4:10] == pytest.approx(np.quantile(np.arange(10.0), 0.9) * np.ones((6, 2)))
    assert not low[10:].any()
    assert not high[10:].any()


def test_aligned_at_the_collision_it_is_taken_back_to_the_start():
    low, high = bands([8] * 10 + [4], "collision")
    assert high[:4] == pytest.approx(np.quantile(np.arange(10.0), 0.9) * np.ones((4, 2)))
    assert high[4:8] == pytest.approx(np.quantile(np.arange(11.0), 0.9) * np.ones((4, 2)))
    assert not high[8:].any()
    assert np.all(low <= high)


def test_the_digest_is_that_of_releases_without_bands():
    noise = tuple(np.full((6, 2), n, np.float32) for n in range(5))
    settings = AnalysisSettings(clusters=1, bootstrap=0)
    result = analyse(Failures(tuple(range(5)), noise), HORIZON, settings)
    without = tuple(replace(mode, band=None) for mode in result.modes)
    assert [mode.number for mode in result.modes] == [1]
    assert result.modes[0].band is not None
    assert hash_result(replace(result, modes=without)) == hash_result(result)
