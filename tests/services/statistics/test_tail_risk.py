"""VaR and CVaR: by hand, in closed form, and what must always hold."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eigenfail.errors import InvalidValue
from eigenfail_services.statistics.tail_risk import (
    RESAMPLES,
    bootstrap_intervals,
    measure_tail,
    tail_risk,
)

HUNDRED = np.arange(1.0, 101.0)


def test_a_hundred_numbers_by_hand() -> None:
    risk = tail_risk(HUNDRED[::-1].copy(), 0.95)
    assert (risk.n, risk.beyond) == (100, pytest.approx(5.0))
    assert risk.mean.value == 50.5
    assert risk.var.value == 95.0
    assert risk.cvar.value == pytest.approx((96 + 97 + 98 + 99 + 100) / 5.0)
    assert risk.var.interval is risk.cvar.interval is None
    assert "hence 300 failures in all" in risk.problem


def test_where_the_quantile_splits_a_value_it_counts_in_part() -> None:
    # The worst 25 % of 1, 2, 3, 4, 5, 6 are 6 and half of the 5: (6 + 0.5 · 5) ÷ 1.5.
    assert measure_tail(np.arange(1.0, 7.0), 0.75) == (5.0, pytest.approx(8.5 / 1.5))


def test_the_mean_has_student_s_interval() -> None:
    # 12, 14, 16: mean 14, s = 2, t(2) = 4.3027: 14 ± 4.3027 · 2 ÷ √3.
    middle = tail_risk(np.array([12.0, 14.0, 16.0]), 0.95).mean
    assert (middle.interval.low, middle.interval.high) == pytest.approx((9.03172, 18.96828), 1e-5)
    assert tail_risk(np.array([2.0, 4.0, 6.0]), 0.95).mean.interval.low == 0.0
    assert tail_risk(np.array([2.0]), 0.95).mean.interval is None


def test_too_few_failures_have_a_mean_and_nothing_else() -> None:
    risk = tail_risk(HUNDRED[:99], 0.95)
    assert risk.mean.value == 50.0
    assert risk.var is risk.cvar is None
    assert "99 failures leave 4.95." in risk.problem
    assert "VaR and CVaR at 95 % need at least 5 failures" in risk.problem


def test_no_failure_has_nothing() -> None:
    risk = tail_risk(np.zeros(0), 0.95)
    assert risk.mean is risk.var is risk.cvar is None
    assert risk.problem == "There is no failure."


@pytest.mark.parametrize("level", [0.0, 1.0, -1.0, 95.0, float("nan")])
def test_a_level_is_a_share(level: float) -> None:
    with pytest.raises(InvalidValue, match="level"):
        tail_risk(HUNDRED, level)


def test_equal_values_have_no_spread() -> None:
    risk = tail_risk(np.full(400, 7.0), 0.95)
    for figure in (risk.mean, risk.var, risk.cvar):
        assert figure.value == figure.interval.low == figure.interval.high == 7.0


def test_it_is_the_same_whenever_it_is_repeated() -> None:
    values = np.random.default_rng(1).exponential(size=1000)
    assert tail_risk(values, 0.9) == tail_risk(np.sort(values), 0.9)


def test_the_short_way_to_resample_is_the_plain_one() -> None:
    ordered = np.sort(np.random.default_rng(2).exponential(size=400))
    random = np.random.default_rng(3)
    plain = [measure_tail(np.sort(random.choice(ordered, 400)), 0.95) for _ in range(4 * RESAMPLES)]
    wanted = np.quantile(plain, [0.025, 0.975], axis=0).T
    found = [(each.low, each.high) for each in bootstrap_intervals(ordered, 0.95)]
    assert found == [pytest.approx(each, rel=0.05) for each in wanted]


def test_its_intervals_hold_the_truth_of_exponential_numbers() -> None:
    # Of Exp(1): VaR = −log 0.05, CVaR = VaR + 1.
    random, var, runs = np.random.default_rng(4), -np.log(0.05), 60
    risks = [tail_risk(random.exponential(size=400), 0.95) for _ in range(runs)]
    held = sum(risk.cvar.interval.low <= var + 1.0 <= risk.cvar.interval.high for risk in risks)
    assert held >= 0.8 * runs
    assert np.mean([risk.cvar.value for risk in risks]) == pytest.approx(var + 1.0, abs=0.1)


@given(
    st.lists(st.floats(0.0, 1e6), min_size=1, max_size=400),
    st.sampled_from([0.5, 0.75, 0.9, 0.95]),
)
def test_the_median_var_cvar_and_the_worst_are_in_order(values: list[float], level: float) -> None:
    array = np.array(values)
    risk = tail_risk(array, level)
    slack = 1e-9 * (1.0 + array.max())
    assert array.min() - slack <= risk.mean.value <= array.max() + slack
    if risk.var is None:
        assert risk.beyond < 5.0
        return
    lower_median = np.sort(array)[(len(array) - 1) // 2]
    assert lower_median <= risk.var.value <= risk.cvar.value + slack
    assert risk.mean.value <= risk.cvar.value + slack
    assert risk.cvar.value <= array.max() + slack
    share = float(np.mean(array <= risk.var.value))
    assert share >= level - 1e-9
    for figure in (risk.var, risk.cvar):
        if figure.interval:
            assert array.min() <= figure.interval.low <= figure.interval.high
            assert figure.interval.high <= array.max() + slack


@given(st.floats(0.1, 100.0), st.floats(-1e3, 1e3))
def test_units_do_not_matter(scale: float, shift: float) -> None:
    plain, moved = measure_tail(HUNDRED, 0.9), measure_tail(scale * HUNDRED + shift, 0.9)
    assert moved == pytest.approx([scale * each + shift for each in plain], rel=1e-6, abs=1e-6)
