"""Every clusterer by name: known groups are found, none are made up, a draw gives them again."""

from typing import Any, get_args, get_type_hints

import numpy as np
import pytest
from sklearn.cluster import HDBSCAN
from sklearn.metrics import adjusted_rand_score

from eigenfail.errors import InvalidValue
from eigenfail.values.analysis import AnalysisSettings, Stability
from eigenfail_services.analysis import clusters
from eigenfail_services.analysis.alignment import check_clusterer
from eigenfail_services.analysis.clusters import (
    CLUSTERERS,
    compute_noise_silhouette,
    divide,
    draw_without_groups,
)

NAMES = sorted(CLUSTERERS)


def blobs(seed: int = 0, strays: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Three groups of 50 in three dimensions, and rows that belong to none."""
    generator = np.random.default_rng(seed)
    labels = np.repeat(range(3), 50)
    rows = 8.0 * np.eye(3)[labels] + generator.standard_normal((150, 3))
    return np.concatenate([rows, generator.uniform(-30, 30, (strays, 3))]), labels


def sphere(count: int, seed: int) -> np.ndarray:
    """A shell: far from the centre in every direction, and no groups."""
    generator = np.random.default_rng(seed)
    rows = generator.standard_normal((count, 3))
    rows /= np.linalg.norm(rows, axis=1, keepdims=True)
    return rows + 0.05 * generator.standard_normal((count, 3))


def test_the_settings_name_all_of_them() -> None:
    (choice,) = [get_type_hints(AnalysisSettings)["clusterer"]]
    assert sorted(get_args(choice)) == NAMES


@pytest.mark.parametrize("name", NAMES)
def test_groups_are_found(name: str) -> None:
    scores, labels = blobs()
    found = divide(scores, None, CLUSTERERS[name])
    assert adjusted_rand_score(labels, found.labels) > 0.95
    assert found.silhouette is not None
    assert found.silhouette > compute_noise_silhouette(scores, 3, CLUSTERERS[name])


@pytest.mark.parametrize("name", ["kmeans", "gaussian_mixture"])
def test_a_number_is_heeded_or_refused(name: str) -> None:
    scores, _ = blobs()
    assert len(np.unique(divide(scores, 4, CLUSTERERS[name]).labels)) == 4
    with pytest.raises(InvalidValue, match="hdbscan finds the number"):
        check_clusterer(AnalysisSettings(clusters=4, clusterer="hdbscan"))
    check_clusterer(AnalysisSettings(clusterer="hdbscan"))


def test_what_belongs_to_no_region_is_put_with_its_neighbour_and_told() -> None:
    scores, labels = blobs(strays=10)
    found = divide(scores, None, CLUSTERERS["hdbscan"])
    assert found.outliers == pytest.approx(10 / 160, abs=0.04)
    assert len(np.unique(found.labels)) == 3
    assert adjusted_rand_score(labels, found.labels[:150]) > 0.95


@pytest.mark.fault("few, identical or constant failures, or none")
@pytest.mark.parametrize("rows", [1, 2, 9, 12])
@pytest.mark.parametrize("name", NAMES)
def test_few_or_equal_rows_make_no_trouble(name: str, rows: int) -> None:
    scores = np.random.default_rng(0).standard_normal((rows, 3))
    for given in (scores, np.zeros((rows, 3)), np.repeat(scores[:1], rows, axis=0)):
        found = divide(given, None, CLUSTERERS[name])
        assert (found.silhouette is None) == (len(np.unique(found.labels)) == 1)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("scale", [1e-6, 1e7, 1e18])
def test_the_unit_of_the_scores_does_not_matter(name: str, scale: float) -> None:
    scores = np.random.default_rng(1).standard_normal((40, 3)) * (3.0, 1.0, 0.2)
    there, here = divide(scores * scale, 4, CLUSTERERS[name]), divide(scores, 4, CLUSTERERS[name])
    assert adjusted_rand_score(here.labels, there.labels) == pytest.approx(1.0)


def test_a_mixture_tells_a_narrow_group_in_a_wide_one() -> None:
    generator = np.random.default_rng(4)
    wide, narrow = generator.normal(0, 6, (150, 2)), generator.normal((9, 0), 0.3, (80, 2))
    scores, labels = np.concatenate([wide, narrow]), np.repeat([0, 1], [150, 80])
    index = {
        name: adjusted_rand_score(labels, divide(scores, 2, CLUSTERERS[name]).labels)
        for name in ("kmeans", "gaussian_mixture")
    }
    assert index["gaussian_mixture"] > index["kmeans"] + 0.2


def test_a_shell_is_held_against_shells() -> None:
    """Normal noise of its covariance has a silhouette of 0.27, and would call it four modes."""
    above = 0
    for seed in range(5):
        scores = sphere(150, seed)
        found = divide(scores, 4).silhouette
        assert found is not None
        assert found > 0.29
        above += found > compute_noise_silhouette(scores, 4)
    assert above <= 1


def test_data_without_groups_lie_as_far_from_the_centre() -> None:
    scores = sphere(200, 0) * [5.0, 2.0, 1.0]
    drawn = draw_without_groups(scores, np.random.default_rng(0))
    spread = scores.std(axis=0)

    def distances(rows: np.ndarray) -> np.ndarray:
        return np.sort(np.linalg.norm(rows / spread, axis=1))

    assert distances(drawn) == pytest.approx(distances(scores - scores.mean(axis=0)))
    assert np.abs(drawn.mean(axis=0) / spread).max() < 0.25
    single = draw_without_groups(np.sign(scores[:, :1]), np.random.default_rng(0))
    assert len(np.unique(np.abs(single))) == 200


def test_of_many_rows_some_are_clustered_and_the_others_join(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    scores, labels = blobs()
    monkeypatch.setattr(clusters, "CLUSTERED_ROWS", 60)
    for name in NAMES:
        found = divide(scores, None, CLUSTERERS[name])
        assert adjusted_rand_score(labels, found.labels) > 0.9, name


def again(data: np.ndarray, **changes: Any) -> Stability | None:
    settings = AnalysisSettings(bootstrap=8, **changes)
    labels = divide(data, settings.clusters, CLUSTERERS[settings.clusterer]).labels
    return clusters.measure_stability(data.astype(np.float32), labels, settings)


@pytest.mark.parametrize("name", NAMES)
def test_modes_come_back_and_artefacts_do_not(name: Any) -> None:
    real = again(blobs()[0], clusterer=name)
    assert (real.median, real.resamples, real.rows) == (pytest.approx(1.0, abs=0.05), 8, 150)
    if name != "hdbscan":
        blob = np.random.default_rng(0).standard_normal((150, 3))
        made_up = again(blob, clusterer=name, clusters=5)
        assert made_up.interval.low <= made_up.median <= made_up.interval.high
        assert made_up.median < 0.75


def test_a_single_mode_or_no_resamples_have_no_stability() -> None:
    data = blobs()[0].astype(np.float32)
    settings = AnalysisSettings(bootstrap=3)
    assert clusters.measure_stability(data, np.zeros(150, np.intp), settings) is None
    labels = np.repeat(range(3), 50)
    assert clusters.measure_stability(data, labels, AnalysisSettings(bootstrap=0)) is None


def test_what_is_in_no_dense_region_joins_its_one_nearest_neighbour() -> None:
    generator = np.random.default_rng(0)
    left, right = (generator.normal((x, 0.0), 0.5, (40, 2)) for x in (0.0, 4.0))
    rows = np.concatenate([left, right, generator.uniform((1.0, -6.0), (3.0, 6.0), (24, 2))])
    labels = HDBSCAN(min_cluster_size=clusters.FEWEST, copy=True).fit_predict(rows)
    inside, strays = labels >= 0, np.flatnonzero(labels < 0)
    distances = np.linalg.norm(rows[strays, None] - rows[None, inside], axis=2)
    nearest, second = labels[inside][np.argsort(distances, axis=1)[:, :2]].T
    assert (nearest != second).any(), "the two nearest neighbours of no stray differ"
    grouping = CLUSTERERS["hdbscan"].fit(rows, 0)
    assert grouping.groups.predict(rows[strays]).tolist() == nearest.tolist()
    assert grouping.outliers == pytest.approx(len(strays) / len(rows))
