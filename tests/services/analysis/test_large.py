"""Large data: the same result as in one piece, in little memory, from whatever portions."""

import tracemalloc
from collections.abc import Iterator

import numpy as np
import pytest

from eigenfail.values.analysis import AnalysisSettings
from eigenfail.values.records import Failures
from eigenfail_services.analysis import components
from eigenfail_services.analysis.alignment import FailureBatch, gather_failures
from eigenfail_services.analysis.components import ComponentSpace, fit_components
from eigenfail_services.analysis.job import analyse, analyse_gathered, hash_result

HORIZON = 40
MIB = 2**20


def coloured(rows: int, columns: int) -> np.ndarray:
    """Data whose components differ clearly in what they explain."""
    generator = np.random.default_rng(0)
    loads = generator.standard_normal((5, columns)) * [[9.0], [6.0], [4.0], [2.0], [1.0]]
    data = generator.standard_normal((rows, 5)) @ loads + generator.standard_normal((rows, columns))
    return (data + 3.0).astype(np.float32)


def same_space(one: ComponentSpace, other: ComponentSpace) -> None:
    assert one.explained == pytest.approx(other.explained, rel=1e-6)
    assert one.components == pytest.approx(other.components, abs=1e-5)
    assert one.scores == pytest.approx(other.scores, abs=1e-3)


@pytest.mark.parametrize("widest", [2_000, 10], ids=["accumulated", "randomised"])
def test_each_way_gives_the_components_of_the_whole_decomposition(
    monkeypatch: pytest.MonkeyPatch, widest: int
) -> None:
    data = coloured(5_000, 60)
    whole = fit_components(data, 4)
    monkeypatch.setattr(components, "SMALL_ENTRIES", 1_000)
    monkeypatch.setattr(components, "WIDEST", widest)
    found = fit_components(data, 4)
    same_space(whole, found)
    again = fit_components(data, 4)
    assert np.array_equal(again.components, found.components)


def test_what_is_smaller_than_rounding_is_no_direction_of_large_data_either(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(components, "SMALL_ENTRIES", 10)
    line = np.outer(np.arange(50.0), np.ones(6)).astype(np.float32)
    assert len(fit_components(line, 4).components) == 1
    assert len(fit_components(np.ones((50, 6), np.float32), 4).components) == 0


def portions(count: int, size: int) -> Iterator[FailureBatch]:
    """So many failures of two modes and differing lengths, some at a time."""
    generator = np.random.default_rng(3)
    noise = generator.standard_normal((count, HORIZON, 2)).astype(np.float32)
    noise[::3, 5:15, 0] += 3.0
    lengths = generator.integers(20, HORIZON + 1, count)
    for first in range(0, count, size):
        rows = range(first, min(first + size, count))
        yield FailureBatch(7, Failures(tuple(rows), tuple(noise[i, : lengths[i]] for i in rows)))


def test_portions_do_not_matter() -> None:
    settings = AnalysisSettings(clusters=2, bootstrap=2)
    digests = {
        hash_result(
            analyse_gathered(gather_failures(given, HORIZON, settings), settings, 0.1, {7: 300})
        )
        for given in (
            portions(240, 240),
            portions(240, 7),
            reversed(list(portions(240, 50))),
        )
    }
    assert len(digests) == 1


def test_gathering_keeps_single_precision_and_few_copies() -> None:
    given = list(portions(6_000, 500))
    size = 6_000 * HORIZON * 2 * 4
    tracemalloc.start()
    found = gather_failures(given, HORIZON, AnalysisSettings())
    space = fit_components(found.data, 3)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert found.noise.dtype == np.float32
    assert len(space.scores) == 6_000
    # Three times the data, what failures are sorted by, and the blocks in double precision.
    assert peak < 4 * size + 12 * MIB


def test_the_result_of_many_holds_scores_and_labels_alone_of_each() -> None:
    one = analyse(next(portions(100, 100)).failures, HORIZON, AnalysisSettings(bootstrap=0))
    assert one.scores.dtype == np.float32
    arrays = [getattr(one, name) for name in ("components", "influence", "explained")]
    assert not any(len(one.episodes) in array.shape for array in arrays)
    for each in one.training:
        assert each.mean.shape == (HORIZON, 2)
