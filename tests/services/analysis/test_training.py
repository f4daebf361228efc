"""Through training: tenths of the episodes, means and components by an independent computation."""

import numpy as np
import pytest

from eigenfail.values.analysis import AnalysisResult, AnalysisSettings
from eigenfail.values.records import Failures
from eigenfail_services.analysis.alignment import FailureBatch, gather_failures
from eigenfail_services.analysis.job import analyse_gathered

HORIZON = 12


def drifting(seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Failures at every third of 300 episodes; the mean and the main direction change half-way."""
    generator = np.random.default_rng(seed)
    indices = np.arange(0, 300, 3)
    late = indices >= 150
    noise = 0.1 * generator.standard_normal((100, HORIZON, 2)) + late[:, None, None]
    swing = generator.standard_normal(100)
    noise[~late, 2, 0] += 3.0 * swing[~late]
    noise[late, 9, 1] += 3.0 * swing[late]
    return indices, noise.astype(np.float32)


def analysed(indices: np.ndarray, noise: np.ndarray, episodes: int) -> AnalysisResult:
    given = FailureBatch(4, Failures(tuple(indices.tolist()), tuple(noise)))
    settings = AnalysisSettings(clusters=1, bootstrap=0)
    return analyse_gathered(
        gather_failures([given], HORIZON, settings), settings, 0.1, {4: episodes}
    )


def test_ten_intervals_share_the_failures() -> None:
    found = analysed(*drifting(), 300).training
    assert [each.failures for each in found] == [10] * 10
    assert [each.start for each in found] == pytest.approx(np.arange(10) / 10)
    assert [each.end for each in found] == pytest.approx(np.arange(1, 11) / 10)


def test_means_and_components_are_those_of_the_interval() -> None:
    indices, noise = drifting()
    found = analysed(indices, noise, 300)
    for tenth, each in enumerate(found.training):
        own = noise[(indices >= 30 * tenth) & (indices < 30 * (tenth + 1))].astype(np.float64)
        assert each.mean == pytest.approx(own.mean(axis=0), abs=1e-5)
        centred = (own - own.mean(axis=0)).reshape(len(own), -1)
        _, singular, axes = np.linalg.svd(centred, full_matrices=False)
        assert each.explained == pytest.approx(singular[:3] ** 2 / np.sum(singular**2), abs=1e-5)
        cosines = np.sum(each.components.reshape(3, -1) * axes[:3], axis=1)
        assert np.abs(cosines) == pytest.approx(np.ones(3), abs=1e-4)
        overall = found.components.reshape(3, -1)
        likeness = np.sum(each.components.reshape(3, -1) * overall, axis=1)
        assert each.likeness == pytest.approx(likeness, abs=1e-5)
        assert (likeness >= 0.0).all()


def test_tenths_without_failures_or_with_one_are_told_as_such() -> None:
    indices, noise = drifting()
    found = analysed(indices[:11], noise[:11], 300).training
    assert [each.failures for each in found] == [10, 1, *[0] * 8]
    assert found[1].components.shape == (0, HORIZON, 2)
    assert found[1].mean == pytest.approx(noise[10])
    assert not found[2].mean.any()


def test_counts_that_lag_behind_do_not_lose_failures() -> None:
    found = analysed(*drifting(), 100).training
    assert sum(each.failures for each in found) == 100
