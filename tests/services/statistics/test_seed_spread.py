"""Mean, spread and ratio over seeds: closed forms, limits, and how often intervals hold."""

from math import inf, sqrt

import numpy as np
import pytest

from eigenfail.errors import InvalidValue
from eigenfail_services.statistics.seed_spread import PairSums, find_ratio, measure_spread

T_1, T_2, T_4 = 12.706204736432095, 4.302652729911275, 2.7764451051977987
"""Student's quantile of 97.5 % with 1, 2 and 4 degrees of freedom, from tables."""


def test_mean_deviation_and_interval_are_students():
    found = measure_spread([1.0, 2.0, 3.0, 4.0, 5.0])
    deviation = sqrt(2.5)
    assert (found.n, found.mean, found.median, found.least, found.most) == (5, 3.0, 3.0, 1.0, 5.0)
    assert found.deviation == pytest.approx(deviation)
    half_width = T_4 * deviation / sqrt(5)
    assert found.interval.low == pytest.approx(3.0 - half_width)
    assert found.interval.high == pytest.approx(3.0 + half_width)


@pytest.mark.parametrize(("values", "quantile"), [([0.4, 0.6], T_1), ([0.4, 0.5, 0.6], T_2)])
def test_two_or_three_seeds_give_wide_intervals(values, quantile):
    found = measure_spread(values)
    half_width = quantile * found.deviation / sqrt(len(values))
    assert found.interval.high - found.mean == pytest.approx(half_width)


def test_no_interval_of_shares_leaves_0_to_1():
    assert measure_spread([0.1, 0.9], 0.0, 1.0).interval.low == 0.0
    assert measure_spread([0.1, 0.9], 0.0, 1.0).interval.high == 1.0
    cut = measure_spread([0.0, 0.0, 0.3], 0.0, 1.0).interval
    assert cut.low == 0.0 < cut.high < 1.0


def test_equal_values_show_no_spread():
    found = measure_spread([0.1] * 3)
    assert (found.mean, found.deviation, found.interval) == (0.1, 0.0, None)
    assert found.is_constant


def test_one_value_has_no_spread_and_none_is_refused():
    found = measure_spread([0.25])
    assert (found.mean, found.deviation, found.interval, found.is_constant) == (
        *(0.25, None, None),
        False,
    )
    with pytest.raises(InvalidValue, match="Give at least one"):
        measure_spread([])


def test_an_even_number_of_seeds_has_the_mean_of_the_middle_two_as_its_median():
    assert measure_spread([4.0, 1.0, 2.0, 9.0]).median == 3.0


def is_inside(ratio, prices, failures):
    """Whether the mean of price − ratio · failures is within t standard errors of 0."""
    rest = np.array(prices) - ratio * np.array(failures)
    error = rest.std(ddof=1) / sqrt(len(rest))
    return abs(rest.mean()) / error


@pytest.mark.parametrize("failures", [[20, 25, 30, 22, 28], [5, 9, 0, 7, 8]])
def test_the_ends_of_a_ratio_are_where_the_rest_is_t_errors_from_0(failures):
    prices = [1.0, 1.1, 0.9, 1.05, 1.0]
    found = find_ratio(PairSums.of(prices, failures))
    assert found.value == pytest.approx(sum(prices) / sum(failures))
    assert found.interval.low < found.value < found.interval.high
    assert found.at_least == found.interval.low
    for end in (found.interval.low, found.interval.high):
        assert is_inside(end, prices, failures) == pytest.approx(T_4)


def test_with_equal_prices_the_ratio_is_that_price_by_the_interval_of_the_mean():
    failures = [20.0, 25.0, 30.0, 22.0, 28.0]
    found, mean = find_ratio(PairSums.of([2.0] * 5, failures)), measure_spread(failures)
    assert found.interval.low == pytest.approx(2.0 / mean.interval.high)
    assert found.interval.high == pytest.approx(2.0 / mean.interval.low)


def test_failures_that_are_not_distinguished_from_0_leave_a_lower_bound_alone():
    failures = [0.0, 0.0, 30.0]
    found, mean = find_ratio(PairSums.of([2.0] * 3, failures)), measure_spread(failures)
    assert mean.interval.low < 0.0
    assert found.interval is None
    assert found.at_least == pytest.approx(2.0 / mean.interval.high)


def test_prices_that_vary_as_much_bound_nothing():
    assert find_ratio(PairSums.of([0.0, 3.0], [4.0, 0.0])) == (0.75, None, None)


@pytest.mark.parametrize(
    ("prices", "failures"),
    [([1.0], [4]), ([1.0, 1.0, 1.0], [4, 4, 4]), ([1.0, 2.0], [2, 4]), ([0.0, 0.0], [2, 4])],
)
def test_what_does_not_vary_gives_no_interval(prices, failures):
    found = find_ratio(PairSums.of(prices, failures))
    assert found == (sum(prices) / sum(failures), None, None)


def test_a_scale_of_prices_scales_the_ratio():
    prices, failures = np.array([1.0, 1.1, 0.9, 1.2]), [9, 14, 11, 12]
    one, small = (find_ratio(PairSums.of(by * prices, failures)) for by in (1.0, 1e-9))
    assert small.value == pytest.approx(1e-9 * one.value)
    assert small.interval.high == pytest.approx(1e-9 * one.interval.high)


def test_without_a_failure_there_is_no_ratio():
    with pytest.raises(InvalidValue, match="there is no failure"):
        find_ratio(PairSums.of([1.0, 2.0], [0, 0]))


RUNS = 4_000


def hold(draws, mean, **bounds):
    """Share of the rows whose interval of the mean holds it; rows of equal values do not count."""
    found = [measure_spread(row, **bounds).interval for row in draws]
    known = [each.low <= mean <= each.high for each in found if each]
    return sum(known) / len(known)


@pytest.mark.parametrize("n", [2, 3, 5, 10])
def test_the_interval_of_a_mean_holds_it_in_95_percent(n):
    draws = np.random.default_rng(n).normal(0.5, 0.1, (RUNS, n))
    assert hold(draws, 0.5) == pytest.approx(0.95, abs=0.011)  # three standard errors


def hold_ratio(pairs, ratio):
    """Share of the pairs of prices and failures whose interval, or bound, holds the ratio."""
    held = 0
    for prices, failures in pairs:
        found = find_ratio(PairSums.of(prices, failures))
        low = found.interval.low if found.interval else found.at_least or 0.0
        held += low <= ratio <= (found.interval.high if found.interval else inf)
    return held / len(pairs)


def draw_normal(random, n):
    failures = random.normal(40.0, 12.0, n)
    return 1.0 + 0.01 * failures + random.normal(0.0, 0.05, n), failures


@pytest.mark.parametrize("n", [3, 5, 10])
def test_the_interval_of_a_ratio_holds_it_in_95_percent(n):
    random = np.random.default_rng(n)
    pairs = [draw_normal(random, n) for _ in range(RUNS)]
    assert hold_ratio(pairs, (1.0 + 0.4) / 40.0) == pytest.approx(0.95, abs=0.011)
