"""Two failure rates: published intervals, and exact tests by hand."""

from fractions import Fraction
from math import comb

import pytest
from hypothesis import given
from hypothesis import strategies as st

from eigenfail.errors import InvalidValue
from eigenfail.intervals import Z, difference, mcnemar, paired_difference, wilson
from eigenfail.values.comparison import PairTotals
from eigenfail.values.estimates import Interval, Rate

# Newcombe 1998, Table II, method 10: p1 − p2 for k1/n1 and k2/n2.
NEWCOMBE = [
    ((56, 70), (48, 80), (0.0524, 0.3339)),
    ((9, 10), (3, 10), (0.1705, 0.8090)),
    ((6, 7), (2, 7), (0.0582, 0.8062)),
    ((5, 56), (0, 29), (-0.0381, 0.1926)),
    ((0, 10), (0, 20), (-0.1611, 0.2775)),
    ((0, 10), (0, 10), (-0.2775, 0.2775)),
    ((10, 10), (0, 20), (0.6791, 1.0)),
    ((10, 10), (0, 10), (0.6075, 1.0)),
]


@pytest.mark.parametrize(("b", "a", "bounds"), NEWCOMBE)
def test_the_published_intervals(b, a, bounds) -> None:
    found = difference(make_rate(*a), make_rate(*b))
    assert found.value == pytest.approx(b[0] / b[1] - a[0] / a[1])
    assert (found.interval.low, found.interval.high) == pytest.approx(bounds, abs=5e-5)
    assert (found.n_a, found.n_b) == (a[1], b[1])


def make_rate(k: int, n: int) -> Rate:
    return Rate(k / n, k, n, wilson(k, n))


shares = st.integers(1, 500).flatmap(lambda n: st.tuples(st.integers(0, n), st.just(n)))


@given(shares, shares)
def test_the_sides_may_be_swapped(a, b) -> None:
    one, other = difference(make_rate(*a), make_rate(*b)), difference(make_rate(*b), make_rate(*a))
    assert one.value == pytest.approx(-other.value)
    assert one.interval.low == pytest.approx(-other.interval.high, abs=1e-12)
    assert -1.0 <= one.interval.low <= one.value + 1e-12
    assert one.value - 1e-12 <= one.interval.high <= 1.0


def count_pairs(both: int, only_first: int, only_second: int, neither: int) -> PairTotals:
    return PairTotals(both, only_first, only_second, neither)


# Both, only the first, only the second, neither; Tango's interval of second less first, from
# Fagerland, Lydersen and Laake 2014, Statistics in Medicine 33, 2850–2875 (data of Bentur et al.
# 2009 and Cavo et al. 2012).
TANGO = [
    ((1, 7, 1, 12), (-0.517, -0.026), 5e-4),
    ((59, 16, 6, 80), (-0.1240, -0.0054), 5e-5),
]


@pytest.mark.parametrize(("cells", "bounds", "rounding"), TANGO)
def test_the_published_intervals_of_pairs(cells, bounds, rounding) -> None:
    found = paired_difference(count_pairs(*cells))
    assert found.value == pytest.approx((cells[2] - cells[1]) / sum(cells))
    assert (found.interval.low, found.interval.high) == pytest.approx(bounds, abs=rounding)
    assert (found.n_a, found.n_b, found.is_paired) == (sum(cells), sum(cells), True)


cells = st.tuples(*[st.integers(0, 300)] * 4).filter(any)


@given(cells)
def test_the_sides_of_pairs_may_be_swapped(cells) -> None:
    both, first, second, neither = cells
    one = paired_difference(count_pairs(*cells))
    other = paired_difference(count_pairs(both, second, first, neither))
    assert one.value == -other.value
    assert one.interval.low == pytest.approx(-other.interval.high, abs=1e-9)
    assert -1.0 <= one.interval.low <= one.value <= one.interval.high <= 1.0


@given(cells)
def test_the_interval_of_pairs_holds_zero_where_mcnemar_does_not_distinguish_them(cells) -> None:
    """Without correction: at 0 Tango's score is that of McNemar."""
    _, first, second, _ = cells
    bounds = paired_difference(count_pairs(*cells)).interval
    is_apart = (first - second) ** 2 > Z**2 * (first + second)
    assert (bounds.low > 0.0 or bounds.high < 0.0) is is_apart


@given(st.integers(1, 10_000))
def test_pairs_that_all_agree_leave_the_score_bound_of_no_event(n) -> None:
    """n·d ÷ √(n·d·(1 − d)) = Z: the upper end of Wilson's interval of 0 in n."""
    bounds = paired_difference(count_pairs(0, 0, 0, n)).interval
    assert bounds.high == pytest.approx(Z**2 / (n + Z**2), rel=1e-9)
    assert bounds.low == pytest.approx(-bounds.high)


def test_without_a_pair_there_is_no_difference() -> None:
    with pytest.raises(InvalidValue):
        paired_difference(PairTotals())


@pytest.mark.parametrize("n", [20, 40])
def test_the_interval_of_pairs_holds_the_truth(n) -> None:
    """The probability of all counts whose interval holds it, summed: no simulation, no error."""
    found = {
        (b, c): paired_difference(count_pairs(0, c, b, n - b - c)).interval
        for b in range(n + 1)
        for c in range(n + 1 - b)
    }
    cover = []
    for p, q in [(p / 20, q / 20) for p in range(1, 10) for q in range(1, 10)]:
        weights = {
            (b, c): comb(n, b) * comb(n - b, c) * p**b * q**c * (1.0 - p - q) ** (n - b - c)
            for b, c in found
        }
        assert sum(weights.values()) == pytest.approx(1.0)
        inside = (w for key, w in weights.items() if found[key].low <= p - q <= found[key].high)
        cover.append(sum(inside))
    assert min(cover) > 0.92
    assert sum(cover) / len(cover) == pytest.approx(0.95, abs=0.01)


def test_episodes_of_a_search_have_no_difference() -> None:
    searched = Rate(0.5, 1, 2, None, sampled=False)
    with pytest.raises(InvalidValue, match="1 of 2 has no interval"):
        difference(make_rate(1, 2), searched)


def test_without_an_estimate_the_share_stands_for_it_inside_the_interval() -> None:
    bounds = Interval(0.1, 0.3)
    found = difference(make_rate(5, 50), Rate(None, 2, 4, bounds))
    assert found.value == pytest.approx(0.3 - 0.1)


@pytest.mark.parametrize(
    ("only_a", "only_b", "p_value"),
    [
        # 2 · (1 + 6) / 2^6; 2 · (1 + 10 + 45) / 2^10.
        (1, 5, 14 / 64),
        (8, 2, 112 / 1024),
        (5, 5, 1.0),
        (0, 1, 1.0),
        (0, 0, 1.0),
        (0, 731, 2.0 * 0.5**731),
    ],
)
def test_mcnemar_by_hand(only_a, only_b, p_value) -> None:
    found = mcnemar(PairTotals(both=7, only_first=only_a, only_second=only_b, neither=90))
    assert found.p_value == pytest.approx(p_value, rel=1e-9)
    assert found.n == 97 + only_a + only_b
    assert (found.only_a, found.only_b, found.both, found.neither) == (only_a, only_b, 7, 90)


@given(st.integers(0, 400).flatmap(lambda n: st.tuples(st.integers(0, n // 2), st.just(n))))
def test_the_p_value_is_the_exact_sum(discordant) -> None:
    rarer, n = discordant
    exact = Fraction(2 * sum(comb(n, k) for k in range(rarer + 1)), 2**n)
    p_value = mcnemar(PairTotals(0, rarer, n - rarer, 0)).p_value
    assert p_value == pytest.approx(min(1.0, float(exact)), rel=1e-9)


def test_the_p_value_of_many_pairs_is_near_the_normal_one() -> None:
    # 1000 below the middle of a million: z = −1999 / 1000 with the correction, Phi(z) = 0.02281.
    p_value = mcnemar(PairTotals(0, 499_000, 501_000, 0)).p_value
    assert p_value == pytest.approx(2 * 0.02281, abs=2e-5)
