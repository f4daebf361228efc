"""Groups: known ones are found, and chance is told from structure."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as st_numpy

from eigenfail_services.analysis import clusters
from eigenfail_services.analysis.clusters import (
    _compute_silhouette,
    _count_different,
    compute_noise_silhouette,
    divide,
    draw_rows,
    order_by_size,
)


def blobs(count: int, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Groups of 20 on a circle, far apart."""
    generator = np.random.default_rng(seed)
    labels = np.repeat(np.arange(count), 20)
    angles = 2.0 * np.pi * np.arange(count) / count
    centres = 20.0 * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    return centres[labels] + generator.standard_normal((len(labels), 2)), labels


def same_groups(one: np.ndarray, other: np.ndarray) -> bool:
    together = one[:, None] == one[None, :]
    return bool(np.array_equal(together, other[:, None] == other[None, :]))


@pytest.mark.parametrize("count", [2, 3, 5, 8])
def test_the_silhouette_finds_how_many_groups_there_are(count: int) -> None:
    scores, labels = blobs(count)
    found = divide(scores, None)
    assert same_groups(found.labels, labels)
    assert found.silhouette is not None
    assert found.silhouette > compute_noise_silhouette(scores, None)


def test_more_groups_than_different_rows_say_nothing() -> None:
    scores = np.repeat([[0.0], [1.0], [5.0]], 10, axis=0)
    assert divide(scores, 3).silhouette is None
    assert divide(scores, 2).silhouette is not None


def test_the_silhouette_by_hand() -> None:
    scores = np.array([[0.0], [1.0], [10.0]])
    labels = np.array([0, 0, 1])
    # (10 - 1) / 10, (9 - 1) / 9, and 0 for the one that is alone.
    assert _compute_silhouette(scores, labels) == pytest.approx((0.9 + 8.0 / 9.0) / 3.0)


def test_rows_that_are_all_alone_have_no_silhouette() -> None:
    assert _compute_silhouette(np.arange(4.0)[:, None], np.arange(4)) == 0.0


def test_of_many_rows_some_speak_for_all(monkeypatch: pytest.MonkeyPatch) -> None:
    scores, labels = blobs(4)
    whole = _compute_silhouette(scores, labels)
    monkeypatch.setattr(clusters, "SILHOUETTE_ROWS", 40)
    sampled = _compute_silhouette(scores, labels)
    assert sampled != whole
    assert sampled == pytest.approx(whole, abs=0.05)


def test_rows_within_rounding_count_once() -> None:
    scores = np.array([[1.0, 2.0], [1.0, 2.0 + 1e-12], [1.0, 2.1], [-1.0, 2.0]])
    assert _count_different(scores) == 3
    assert _count_different(np.zeros((5, 2))) == 1
    assert _count_different(np.zeros((5, 0))) == 1


def test_groups_are_numbered_by_size_and_then_by_their_earliest_episode() -> None:
    labels = np.array([2, 0, 0, 1, 1, 1, 2])
    episodes = np.array([8, 9, 3, 5, 6, 7, 4])
    assert order_by_size(labels, episodes).tolist() == [2, 1, 1, 0, 0, 0, 2]


def test_noise_is_drawn_as_wide_as_the_scores() -> None:
    """Noise along one axis falls apart more easily than noise along three."""
    generator = np.random.default_rng(0)
    flat = generator.standard_normal((60, 3)) * [10.0, 0.01, 0.01]
    round_ = generator.standard_normal((60, 3))
    assert compute_noise_silhouette(flat, 2) > compute_noise_silhouette(round_, 2) + 0.1


@pytest.mark.parametrize("rows", [40, 100])
def test_no_row_is_drawn_twice(rows: int) -> None:
    chosen = draw_rows(rows, 60)
    assert len(np.unique(chosen)) == len(chosen) == min(rows, 60)
    assert set(chosen.tolist()) <= set(range(rows))


@given(
    st_numpy.arrays(
        np.float64,
        st.tuples(st.integers(1, 10), st.integers(0, 3)),
        elements=st.floats(-9, 9) | st.integers(-1, 1).map(float),
    ),
    st.none() | st.integers(1, 6),
)
@settings(max_examples=60, deadline=None)
def test_each_row_is_with_the_centre_nearest_to_it(scores: np.ndarray, wanted: int | None) -> None:
    labels = divide(scores, wanted).labels
    centres = np.array([scores[labels == label].mean(axis=0) for label in np.unique(labels)])
    distances = np.linalg.norm(scores[:, None] - centres[None], axis=2)
    own = distances[np.arange(len(scores)), labels]
    assert own == pytest.approx(distances.min(axis=1), abs=1e-6)
    assert len(centres) == 1 or wanted is None or len(centres) == wanted
