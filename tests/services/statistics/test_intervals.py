"""Intervals against published figures, their defining equations, and simulation."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.special import betaln, xlog1py, xlogy

from eigenfail.errors import InvalidValue
from eigenfail.intervals import ERROR, Z, find_interval, find_upper_bound, wilson
from eigenfail.values.estimates import Interval
from eigenfail_services.statistics.intervals import (
    bound_sequence,
    clopper_pearson,
    confidence_sequence,
    rate,
)


@st.composite
def shares(draw: st.DrawFn) -> tuple[int, int]:
    n = draw(st.integers(1, 10_000_000))
    return draw(st.integers(0, n)), n


@pytest.mark.parametrize(
    ("k", "n", "low", "high"),
    [
        # Newcombe 1998, Statistics in Medicine 17, 857-872, table I, method 3.
        (81, 263, 0.2553, 0.3662),
        (15, 148, 0.0624, 0.1605),
        (0, 20, 0.0000, 0.1611),
        (1, 29, 0.0061, 0.1718),
        # By hand: centre 10.92073 / 303.84146, half width 0.0064506 · sqrt(8.73 + 0.960365).
        (9, 300, 0.0159, 0.0560),
    ],
)
def test_wilson_gives_the_published_figures(k: int, n: int, low: float, high: float) -> None:
    found = wilson(k, n)
    assert (round(found.low, 4), round(found.high, 4)) == (low, high)


@given(shares())
def test_wilson_ends_where_k_is_z_deviations_off(share: tuple[int, int]) -> None:
    k, n = share
    found = wilson(k, n)
    for p in (found.low, found.high):
        assert (k - n * p) ** 2 == pytest.approx(Z**2 * n * p * (1.0 - p), rel=1e-6, abs=1e-6)


@given(shares())
def test_an_interval_holds_the_share_and_stays_between_0_and_1(share: tuple[int, int]) -> None:
    k, n = share
    found = find_interval(k, n)
    assert 0.0 <= found.low <= k / n <= found.high <= 1.0
    assert found.low < found.high
    assert (found.low == 0.0) == (k == 0)
    assert (found.high == 1.0) == (k == n)


@given(shares())
def test_events_and_their_absence_mirror_each_other(share: tuple[int, int]) -> None:
    k, n = share
    found, mirrored = find_interval(k, n), find_interval(n - k, n)
    assert found.low == pytest.approx(1.0 - mirrored.high, abs=1e-12)
    assert found.high == pytest.approx(1.0 - mirrored.low, abs=1e-12)


@given(shares(), st.integers(2, 100))
def test_more_trials_with_the_same_share_say_more(share: tuple[int, int], times: int) -> None:
    k, n = share
    once, often = find_interval(k, n), find_interval(times * k, times * n)
    assert often.high - often.low < once.high - once.low


@given(st.integers(2, 2000), st.data())
def test_one_more_event_raises_both_ends(n: int, data: st.DataObject) -> None:
    k = data.draw(st.integers(0, n - 1))
    fewer, more = find_interval(k, n), find_interval(k + 1, n)
    assert fewer.low < more.low
    assert fewer.high < more.high


def test_no_event_in_2000_is_the_paper_s_bound_of_0_15_percent() -> None:
    assert rate(0, 2000).interval.low == 0.0
    assert rate(0, 2000).interval.high == pytest.approx(0.0015, abs=5e-6)


@given(st.integers(1, 10_000_000))
def test_the_bound_leaves_no_event_a_chance_of_5_percent(n: int) -> None:
    bound = find_upper_bound(0, n, ERROR)
    assert (1.0 - bound) ** n == pytest.approx(0.05, rel=1e-6)
    assert bound < 3.0 / n


@pytest.mark.parametrize("n", [30, 300, 2000])
@pytest.mark.parametrize("expected", [1.0, 3.5, 8.0, 14.0])
def test_at_no_probability_do_many_more_than_one_in_twenty_miss(n: int, expected: float) -> None:
    p = expected / n
    assert coverage(np.full(20_000, p), n, seed=n) >= 0.915


@pytest.mark.parametrize("n", [30, 2000])
def test_the_worst_case_is_as_documented(n: int) -> None:
    assert coverage(np.full(20_000, 0.174 / n), n, seed=n) == pytest.approx(0.84, abs=0.01)


@pytest.mark.parametrize("n", [10, 100, 1000])
def test_over_all_probabilities_nineteen_of_twenty_intervals_hold_the_truth(n: int) -> None:
    p = np.random.default_rng(7).random(20_000)
    assert coverage(p, n, seed=n) == pytest.approx(0.95, abs=0.01)


def coverage(p: np.ndarray, n: int, seed: int) -> float:
    counts = np.random.default_rng(seed).binomial(n, p)
    table = [find_interval(k, n) for k in range(n + 1)]
    low = np.array([found.low for found in table])[counts]
    high = np.array([found.high for found in table])[counts]
    return float(np.mean((low <= p) & (p <= high)))


@pytest.mark.parametrize(
    ("k", "n", "low", "high"),
    [
        # Newcombe 1998, Statistics in Medicine 17, 857-872, table I, method 5.
        (81, 263, 0.2527, 0.3676),
        (15, 148, 0.0578, 0.1617),
        (0, 20, 0.0000, 0.1684),
        (1, 29, 0.0009, 0.1776),
        (29, 29, 0.8806, 1.0000),  # 0.025^(1/29)
    ],
)
def test_the_exact_interval_gives_the_published_figures(k, n, low, high) -> None:
    found = clopper_pearson(k, n)
    assert (found.low, found.high) == pytest.approx((low, high), abs=5e-5)


@pytest.mark.parametrize(("p", "rounds"), [(0.3, 1), (0.3, 10), (0.05, 1), (0.05, 10)])
def test_a_confidence_sequence_holds_at_all_looks_at_once(p: float, rounds: int) -> None:
    outcomes = np.random.default_rng(18).random((2000, 300)) < p
    counts = outcomes.cumsum(axis=1)[:, rounds - 1 :: rounds]
    held = np.ones(len(counts), bool)
    for place, n in enumerate(range(rounds, 301, rounds)):
        known = {k: confidence_sequence(k, n) for k in np.unique(counts[:, place]).tolist()}
        inside = {k: found.low <= p <= found.high for k, found in known.items()}
        held &= np.array([inside[k] for k in counts[:, place].tolist()])
    assert held.mean() >= 0.95


@given(shares())
def test_a_confidence_sequence_ends_where_the_likelihood_ratio_is_20(
    share: tuple[int, int],
) -> None:
    k, n = share
    found = confidence_sequence(k, n)
    assert 0.0 <= found.low <= k / n <= found.high <= 1.0
    ends = [p for p in (found.low, found.high) if 1e-9 < p < 1.0 - 1e-9]
    for p in ends:
        mixed = betaln(k + 0.5, n - k + 0.5) - betaln(0.5, 0.5)
        ratio = mixed - (xlogy(k, p) + xlog1py(n - k, -p))
        assert ratio == pytest.approx(np.log(20.0), abs=1e-4)


@given(shares())
def test_a_confidence_sequence_is_wider_than_one_look(
    share: tuple[int, int],
) -> None:
    k, n = share
    sequence, once = confidence_sequence(k, n), clopper_pearson(k, n)
    assert sequence.high - sequence.low > 0.99 * (once.high - once.low)


def test_doubtful_trials_raise_the_upper_end_of_a_sequence_alone() -> None:
    low, high = confidence_sequence(3, 40).low, confidence_sequence(5, 40).high
    assert bound_sequence(3, 40, doubtful=2) == Interval(low, high)
    assert bound_sequence(39, 40, doubtful=2).high == 1.0


def test_a_rate_says_what_it_rests_on() -> None:
    found = rate(9, 300)
    assert (found.value, found.k, found.n) == (0.03, 9, 300)
    assert found.interval == find_interval(9, 300)
    assert isinstance(found.interval, Interval)


@pytest.mark.parametrize(("k", "n"), [(0, 0), (1, 0), (-1, 5), (6, 5), (0, -3)])
def test_what_is_no_share_is_refused(k: int, n: int) -> None:
    with pytest.raises(InvalidValue, match=f"{k} of {n}"):
        rate(k, n)
