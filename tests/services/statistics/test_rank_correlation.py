"""Spearman's ρ: by hand, and where it says nothing."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eigenfail_services.statistics.comparison import _rank, rank_correlation

TEN = np.arange(10.0)


def test_equal_values_share_their_rank() -> None:
    assert _rank(np.array([3.0, 1.0, 3.0, 0.0])).tolist() == [3.5, 2.0, 3.5, 1.0]


def test_ten_pairs_by_hand() -> None:
    # 1 − 6 Σ d² ÷ (n (n² − 1)), two neighbours swapped: d² sums to 2.
    swapped = TEN[[1, 0, *range(2, 10)]]
    found = rank_correlation(TEN, swapped)
    assert found.value == pytest.approx(1.0 - 12.0 / 990.0)
    # tanh(atanh 0.987879 ± 1.959964 · √(1.487952 ÷ 7))
    assert (found.interval.low, found.interval.high) == pytest.approx(
        (0.928348, 0.998001), abs=1e-6
    )


def test_what_rises_with_it_is_1_whatever_its_shape() -> None:
    assert rank_correlation(TEN, np.exp(TEN)).value == pytest.approx(1.0)
    assert rank_correlation(TEN, -np.exp(TEN)).value == pytest.approx(-1.0)


def test_it_says_nothing_of_few_or_of_what_does_not_vary() -> None:
    assert rank_correlation(TEN[:9], TEN[:9]) is None
    assert rank_correlation(TEN, np.ones(10)) is None


@given(st.lists(st.tuples(st.floats(-9, 9), st.floats(-9, 9)), min_size=10, max_size=60))
def test_it_is_within_its_interval_and_that_within_1(pairs: list[tuple[float, float]]) -> None:
    found = rank_correlation(*np.array(pairs).T)
    if found is not None:
        assert -1.0 <= found.interval.low <= found.value <= found.interval.high <= 1.0
