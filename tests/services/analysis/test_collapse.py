"""Mode collapse: told from noise, measured by hand, and warned of."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eigenfail.errors import InvalidValue
from eigenfail.values import AnalysisResult, AnalysisSettings
from eigenfail.values.records import Failures
from eigenfail_services.analysis.collapse import coverage, diversity, effective_modes, spread
from eigenfail_services.analysis.job import analyse

HORIZON = 100


def result(labels: list[int], distinct: bool = True) -> AnalysisResult:
    """What an analysis may have found in as many failures, one each 10 episodes."""
    nothing = np.zeros((0, 0), np.float32)
    return AnalysisResult(
        episodes=tuple(range(0, 10 * len(labels), 10)),
        explained=nothing[0:0].ravel(),
        components=nothing,
        scores=nothing,
        labels=tuple(labels),
        modes=(),
        influence=nothing,
        silhouette=0.6 if distinct else 0.16,
        noise_silhouette=0.17,
    )


def failures(count: int, scale: float = 1.0, steps: int = 6) -> Failures:
    """Independent noise of a standard deviation of `scale`."""
    noise = scale * np.random.default_rng(0).standard_normal((count, steps, 2))
    return Failures(tuple(range(0, 10 * count, 10)), tuple(noise.astype(np.float32)))


def test_modes_by_hand() -> None:
    labels = [0] * 10 + [1] * 6 + [2] * 4
    found = diversity(failures(20), result(labels), 200)
    assert (found.failures, found.modes, found.largest_share) == (20, 3, 0.5)
    # exp(0.5 ln 2 + 0.3 ln (1 / 0.3) + 0.2 ln 5)
    assert found.effective_modes == pytest.approx(2.8001, abs=1e-4)
    assert found.coverage == (1, 1, 1, 1, 1, 2, 2, 2, 3, 3)
    assert found.warning == ""
    assert found.verdict.startswith(
        "3 modes (silhouette 0.60, on noise 0.17); the largest holds 50 %"
    )


def test_past_ninety_percent_there_is_a_warning() -> None:
    at_the_limit = diversity(failures(20), result([0] * 18 + [1] * 2), 200)
    assert (at_the_limit.largest_share, at_the_limit.warning) == (0.9, "")
    beyond = diversity(failures(20), result([0] * 19 + [1]), 200)
    assert beyond.warning.startswith("mode collapse: 95 % of the failures are of one mode")
    for remedy in ("ensemble", "dissimilarity", "distribution of scenarios"):
        assert remedy in beyond.warning


def test_clusters_of_noise_are_one_mode_and_no_collapse() -> None:
    found = diversity(failures(40), result([0] * 39 + [1], distinct=False), 400)
    assert (found.modes, found.largest_share, found.effective_modes) == (1, 1.0, 1.0)
    assert found.verdict.startswith("One mode, or none that can be told from noise")
    assert found.spread == pytest.approx(1.0, abs=0.1)
    assert found.warning == ""


def test_failures_that_hardly_differ_have_collapsed_though_no_cluster_shows() -> None:
    found = diversity(failures(40, scale=0.2), result([0] * 40, distinct=False), 400)
    assert found.spread == pytest.approx(0.2, abs=0.02)
    assert found.warning.startswith("mode collapse: the failures differ by 0.20 sigma only")
    assert diversity(failures(9, scale=0.2), result([0] * 9, distinct=False), 90).warning == ""


def test_a_real_analysis_of_planted_modes_and_of_noise(
    plant: Callable[..., Any], structureless: Callable[[int], Failures]
) -> None:
    planted = plant(0, 1.0).failures
    found = diversity(planted, analyse(planted, HORIZON, AnalysisSettings()), 400)
    assert (found.modes, len(found.coverage), found.coverage[-1]) == (3, 10, 3)
    shares = np.array([90, 60, 40]) / 190
    assert found.effective_modes == pytest.approx(np.exp(-shares @ np.log(shares)), rel=0.02)
    noise = structureless(1)
    assert diversity(noise, analyse(noise, HORIZON, AnalysisSettings()), 400).modes == 1


@given(st.lists(st.integers(1, 50), min_size=1, max_size=8))
def test_the_effective_number_lies_between_one_and_all(sizes: list[int]) -> None:
    shares = np.array(sizes) / sum(sizes)
    assert 1.0 - 1e-9 <= effective_modes(shares) <= len(sizes) + 1e-9
    assert effective_modes(np.full(len(sizes), 1.0 / len(sizes))) == pytest.approx(len(sizes))


def test_coverage_reaches_all_modes_even_if_counts_lag_behind() -> None:
    labels, indices = np.array([0, 1, 0]), np.array([0, 50, 99])
    assert coverage(labels, indices, 100) == (1, 1, 1, 1, 1, 2, 2, 2, 2, 2)
    assert coverage(labels, indices, 40)[-1] == 2


def test_spread_leaves_out_steps_that_one_failure_alone_reaches() -> None:
    long, short = np.zeros((3, 2), np.float32), np.ones((2, 2), np.float32)
    both = Failures((0, 1), (long, short))
    # Two values, 0 and 1: a variance of 1/2 in each step of the two that both reach.
    assert spread(both) == pytest.approx(np.sqrt(0.5))
    assert spread(Failures((0,), (long,))) is None
    assert spread(Failures((0, 1), (long[:0], short[:0]))) is None


def test_a_single_failure_is_one_mode() -> None:
    found = diversity(failures(1), result([0], distinct=False), 1)
    assert (found.modes, found.spread, found.warning) == (1, None, "")


@pytest.mark.parametrize("count", [0, 3])
def test_other_failures_than_those_analysed_are_refused(count: int) -> None:
    with pytest.raises(InvalidValue, match="not the ones that were analysed"):
        diversity(failures(count), result([0] * 2), 30)
