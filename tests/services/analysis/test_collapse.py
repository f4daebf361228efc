"""Mode collapse: told from noise, measured by hand, and warned of."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from msgspec.structs import replace

from eigenfail.testing.examples import analysis_result
from eigenfail.values.analysis import AnalysisResult, AnalysisSettings, FailureMode
from eigenfail.values.records import Failures
from eigenfail_services.analysis.alignment import Aligned, FailureBatch, gather_failures
from eigenfail_services.analysis.job import analyse
from eigenfail_services.analysis.training import (
    count_effective_modes,
    measure_diversity,
    measure_spread,
)

HORIZON = 100


def result(labels: list[int], distinct: bool = True) -> AnalysisResult:
    """What an analysis may have found in as many failures, one each 10 episodes."""
    nothing = np.zeros((0, 0), np.float32)
    return replace(
        analysis_result(),
        episodes=tuple(range(0, 10 * len(labels), 10)),
        labels=tuple(labels),
        modes=tuple(
            FailureMode(labels.count(mode), labels.index(mode), nothing, nothing)
            for mode in range(max(labels) + 1)
        ),
        silhouette=0.6 if distinct else 0.16,
        noise_silhouette=0.17,
    )


def aligned(*noise: np.ndarray, align: Any = "start") -> Aligned:
    """One failure each 10 episodes of campaign 1."""
    rows = tuple(z.astype(np.float32) for z in noise)
    given = Failures(tuple(range(0, 10 * len(rows), 10)), rows)
    return gather_failures([FailureBatch(1, given)], HORIZON, AnalysisSettings(align=align))


def failures(count: int, scale: float = 1.0, steps: int = 6) -> Aligned:
    """Independent noise of a standard deviation of `scale`."""
    return aligned(*scale * np.random.default_rng(0).standard_normal((count, steps, 2)))


def test_modes_by_hand() -> None:
    labels = [0] * 10 + [1] * 6 + [2] * 4
    found = measure_diversity(failures(20), result(labels), {1: 200})
    assert (found.failures, found.modes, found.largest_share) == (20, 3, 0.5)
    # exp(0.5 ln 2 + 0.3 ln (1 / 0.3) + 0.2 ln 5)
    assert found.effective_modes == pytest.approx(2.8001, abs=1e-4)
    assert found.coverage == (1, 1, 1, 1, 1, 2, 2, 2, 3, 3)
    assert found.warning == ""
    assert found.verdict.startswith(
        "3 distinct modes (silhouette 0.60, on data without groups 0.17). The largest holds 50 %"
    )


def test_past_ninety_percent_there_is_a_warning() -> None:
    at_the_limit = measure_diversity(failures(20), result([0] * 18 + [1] * 2), {1: 200})
    assert (at_the_limit.largest_share, at_the_limit.warning) == (0.9, "")
    beyond = measure_diversity(failures(20), result([0] * 19 + [1]), {1: 200})
    assert beyond.warning.startswith("mode collapse: 95 % of the failures are of one mode")
    assert at_the_limit.collapse == ""
    assert beyond.collapse == (
        "Mode collapse: 95 % of the failures are of one mode. Try the method ensemble, the reward "
        "dissimilarity, or a distribution of scenarios."
    )
    for remedy in ("ensemble", "dissimilarity", "distribution of scenarios"):
        assert remedy in beyond.warning


def test_clusters_of_noise_are_one_mode_and_no_collapse() -> None:
    found = measure_diversity(failures(40), result([0] * 39 + [1], distinct=False), {1: 400})
    assert (found.modes, found.largest_share, found.effective_modes) == (1, 1.0, 1.0)
    assert found.verdict.startswith(
        "No distinct modes: clusters cannot be distinguished from noise"
    )
    assert found.spread == pytest.approx(1.0, abs=0.1)
    assert found.warning == ""


def test_failures_that_hardly_differ_have_collapsed_though_no_cluster_shows() -> None:
    found = measure_diversity(failures(40, scale=0.2), result([0] * 40, distinct=False), {1: 400})
    assert found.spread == pytest.approx(0.2, abs=0.02)
    assert found.warning.startswith("mode collapse: the failures differ by 0.20 sigma only")
    assert found.collapse.startswith("Mode collapse: the failures differ by 0.20 sigma only. Try")
    assert (
        measure_diversity(failures(9, scale=0.2), result([0] * 9, distinct=False), {1: 90}).warning
        == ""
    )


def test_a_real_analysis_of_planted_modes_and_of_noise(
    plant: Callable[..., Any], structureless: Callable[[int], Failures]
) -> None:
    asked = AnalysisSettings(bootstrap=0)
    found = analyse(plant(0, 1.0).failures, HORIZON, asked).diversity
    assert (found.modes, len(found.coverage), found.coverage[-1]) == (3, 10, 3)
    shares = np.array([90, 60, 40]) / 190
    assert found.effective_modes == pytest.approx(np.exp(-shares @ np.log(shares)), rel=0.02)
    alike = analyse(structureless(1), HORIZON, asked).diversity
    assert alike.modes == 1


@given(st.lists(st.integers(1, 50), min_size=1, max_size=8))
def test_the_effective_number_lies_between_one_and_all(sizes: list[int]) -> None:
    shares = np.array(sizes) / sum(sizes)
    assert 1.0 - 1e-9 <= count_effective_modes(shares) <= len(sizes) + 1e-9
    assert count_effective_modes(np.full(len(sizes), 1.0 / len(sizes))) == pytest.approx(len(sizes))


def test_coverage_reaches_all_modes_even_if_counts_lag_behind() -> None:
    assert measure_diversity(failures(20), result([0] * 19 + [1]), {1: 40}).coverage[-1] == 2


@pytest.mark.parametrize("align", ["start", "collision"])
def test_spread_leaves_out_steps_that_one_failure_alone_reaches(align: Any) -> None:
    long, short = np.zeros((3, 2)), np.ones((2, 2))
    # Two values, 0 and 1: a variance of 1/2 in each step of the two that both reach.
    assert measure_spread(aligned(long, short, align=align)) == pytest.approx(np.sqrt(0.5))
    assert measure_spread(aligned(long, align=align)) is None
    assert measure_spread(aligned(long[:0], short[:0], align=align)) is None


@given(st.lists(st.integers(0, 5), min_size=1, max_size=6), st.integers(0, 99))
def test_spread_is_numpys_standard_deviation(lengths: list[int], seed: int) -> None:
    generator = np.random.default_rng(seed)
    noise = [generator.standard_normal((steps, 2)).astype(np.float32) for steps in lengths]
    table = np.full((len(noise), 5, 2), np.nan)
    for row, z in zip(table, noise, strict=True):
        row[: len(z)] = z
    reached = np.isfinite(table[:, :, 0]).sum(axis=0) >= 2
    found = measure_spread(aligned(*noise))
    assert (found is None) == (not reached.any())
    if found is not None:
        assert found**2 == pytest.approx(np.nanvar(table[:, reached], axis=0, ddof=1).mean())
