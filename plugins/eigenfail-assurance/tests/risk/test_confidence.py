"""Bounds of sums of products: closed forms, and what a further scenario does to them."""

from dataclasses import replace
from math import exp, inf, log, log1p, sqrt

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import stats

from eigenfail.intervals import Z
from eigenfail.values.estimates import Estimate, Interval
from eigenfail_assurance.risk.confidence import (
    EventRate,
    FailureShare,
    RiskTerm,
    RunEstimate,
    Stated,
    bound_factor,
    bound_sum,
)
from eigenfail_services.statistics.intervals import clopper_pearson, log_normal

EXACTLY_2 = Stated(2.0, 2.0, 2.0)
CLOSE = 1e-3
"""Relative error of quantiles that are read from a grid."""


def make_share(k, n, errored=0):
    return FailureShare(k, errored, n, k / n)


def make_term(probability, exposure=EXACTLY_2, name="a", noise="seed 1", episodes=1_000):
    return RiskTerm(name, exposure, probability, noise, episodes)


@pytest.mark.parametrize(("k", "n"), [(1, 30), (3, 1_000), (40, 50), (17, 10**6)])
def test_one_scenario_of_known_exposure_has_the_exact_interval(k, n):
    found = bound_sum([make_term(make_share(k, n))])
    exact = clopper_pearson(k, n)
    assert found.interval.low == pytest.approx(2.0 * exact.low, rel=CLOSE)
    assert found.interval.high == pytest.approx(2.0 * exact.high, rel=CLOSE)
    assert found.at_least == pytest.approx(2.0 * stats.beta.ppf(0.05, k, n - k + 1), rel=CLOSE)
    assert found.at_most == pytest.approx(2.0 * stats.beta.ppf(0.95, k + 1, n - k), rel=CLOSE)


def test_without_a_failure_there_is_the_rule_of_three():
    found = bound_sum([make_term(make_share(0, 1_000))])
    assert found.interval.low == found.at_least == 0.0
    assert found.at_most == pytest.approx(2.0 * (1.0 - 0.05 ** (1.0 / 1_000)), rel=CLOSE)
    assert found.interval.high == pytest.approx(2.0 * (1.0 - 0.025 ** (1.0 / 1_000)), rel=CLOSE)


def test_errored_episodes_count_as_failures_in_the_upper_bound_alone():
    found = bound_factor(make_share(3, 100, errored=2))
    assert found.low == pytest.approx(clopper_pearson(3, 100).low, rel=CLOSE)
    assert found.high == pytest.approx(clopper_pearson(5, 100).high, rel=CLOSE)
    assert bound_factor(make_share(4, 5, errored=1)).high == 1.0


@pytest.mark.parametrize("k", [0, 1, 7, 400])
def test_encounters_have_the_exact_interval_of_a_poisson_number(k):
    found = bound_factor(EventRate(k, 50.0))
    low = stats.chi2.ppf(0.025, 2 * k) / 100.0 if k else 0.0
    assert found.low == pytest.approx(low, rel=CLOSE)
    assert found.high == pytest.approx(stats.chi2.ppf(0.975, 2 * k + 2) / 100.0, rel=CLOSE)


@pytest.mark.parametrize("effective", [2.0, 3.0, 10.0, inf])
def test_an_estimate_keeps_its_own_interval(effective):
    interval = log_normal(1e-5, 0.4, effective)
    estimate = Estimate(by="x", episodes=9, probability=1e-5, cv=0.4, interval=interval)
    found = bound_factor(RunEstimate.of(estimate))
    assert found.low == pytest.approx(interval.low, rel=5 * CLOSE)
    assert found.high == pytest.approx(interval.high, rel=5 * CLOSE)


def test_an_estimate_is_no_more_than_1():
    interval = log_normal(0.8, 0.6)
    estimate = Estimate(by="x", episodes=9, probability=0.8, cv=0.6, interval=interval)
    assert bound_factor(RunEstimate.of(estimate)).high == 1.0


@pytest.mark.parametrize(
    "fields",
    [
        {"interval": None},
        {"interval": Interval(1e-6, 1e-4), "bound": "lower"},
        {"interval": Interval(1e-6, 1e-4), "cv": None},
        {"interval": Interval(1e-6, 1e-4), "probability": None},
    ],
)
def test_an_estimate_without_an_interval_of_its_own_states_nothing(fields):
    whole = {"by": "x", "episodes": 9, "probability": 1e-5, "cv": 0.4, **fields}
    assert RunEstimate.of(Estimate(**whole)) is None


def test_a_stated_interval_is_kept_also_where_it_is_lopsided():
    found = bound_factor(Stated(0.2, 0.1, 0.9))
    assert (found.low, found.high) == pytest.approx((0.1, 0.9), rel=CLOSE)
    assert np.median(Stated(0.2, 0.1, 0.9).draw_upper()) == pytest.approx(0.2, rel=CLOSE)
    open_below = bound_factor(Stated(0.0, 0.0, 0.9))
    assert (open_below.low, open_below.high) == pytest.approx((0.0, 0.9), rel=CLOSE)
    assert bound_factor(Stated(0.0, 0.0, 0.0)) == Interval(0.0, 0.0)


def test_a_product_of_two_log_normal_factors_is_log_normal():
    spread, known = sqrt(log1p(0.25)), Stated(3.0, 3.0 * exp(-Z * 0.3), 3.0 * exp(Z * 0.3))
    found = bound_sum([make_term(RunEstimate(0.01, 0.5, inf), known)])
    width = Z * sqrt(spread**2 + 0.3**2)
    assert log(found.interval.high / 0.03) == pytest.approx(width, rel=0.02)
    # Draws of the lower distributions are cut, which lowers the bound of their product.
    assert width <= log(0.03 / found.interval.low) < 1.15 * width


def test_the_sum_of_poisson_numbers_with_equal_weights_is_one_poisson_number():
    """Of many parts the sum of Gamma(k) is the lower bound of all encounters, exactly."""
    certain = Stated(1.0, 1.0, 1.0)
    terms = [make_term(certain, EventRate(5, 100.0), f"part {part}") for part in range(4)]
    found = bound_sum(terms)
    assert found.interval.low == pytest.approx(bound_factor(EventRate(20, 100.0)).low, rel=0.02)
    # The upper bound is that of 4 more encounters than were counted, not of one more.
    assert found.interval.high == pytest.approx(stats.gamma.ppf(0.975, 24) / 100.0, rel=0.02)


def test_the_same_noise_widens_the_interval():
    shares = [make_share(10, 1_000)] * 4
    apart = bound_sum([make_term(each, name=str(i), noise=str(i)) for i, each in enumerate(shares)])
    alike = bound_sum([make_term(each, name=str(i)) for i, each in enumerate(shares)])
    exact = clopper_pearson(10, 1_000)
    assert alike.interval.high == pytest.approx(8.0 * exact.high, rel=CLOSE)
    assert alike.interval.low == pytest.approx(8.0 * exact.low, rel=CLOSE)
    assert apart.interval.high < 0.9 * alike.interval.high
    assert apart.interval.low > 1.1 * alike.interval.low


@pytest.mark.parametrize("known", [Stated(2.0, 1.0, 4.0), Stated(2.0, 0.1, 3.0)])
def test_the_lower_draws_of_a_stated_value_have_the_mean_of_the_truth_at_most(known):
    """The mean of the value itself is exp(s² ÷ 2) times the truth, with s its standard error."""
    error = log(known.value / known.low) / Z
    assert known.draw_lower().mean() * exp(error**2 / 2.0) < known.value


@pytest.mark.parametrize("freedom", [1.0, 3.0, 9.0, inf])
def test_the_lower_draws_of_runs_have_the_mean_of_the_estimate_at_most(freedom):
    assert RunEstimate(0.01, 0.5, freedom).draw_lower().mean() < 0.01


LOG_ERROR = log(4.0) / Z


def make_stated(generator):
    value = exp(LOG_ERROR * generator.standard_normal())
    return Stated(value, value / 4.0, value * 4.0)


def make_runs(generator):
    """The mean of two runs with log-normal errors, without bias."""
    runs = np.exp(0.8 * generator.standard_normal(2) - 0.32)
    value = float(runs.mean()) * 1e-3
    return RunEstimate(value, float(runs.std(ddof=1)) / sqrt(2.0) * 1e-3 / value, 1.0)


@pytest.mark.parametrize("size", [3, 40])
@pytest.mark.parametrize("make", [make_stated, make_runs])
def test_the_lower_bound_of_many_log_normal_factors_holds(make, size):
    """Without the cut it held in no more than 30 of 40 sums of 40."""
    generator, held = np.random.default_rng(11), 0
    truth = size * (1.0 if make is make_stated else 2e-3)
    for _ in range(40):
        known = [make(generator) for _ in range(size)]
        terms = [
            RiskTerm(f"{at}", each if make is make_stated else EXACTLY_2, share, f"{at}", 100)
            for at, each in enumerate(known)
            for share in [Stated(1.0, 1.0, 1.0) if make is make_stated else each]
        ]
        held += bound_sum(terms).at_least <= truth
    assert held >= 36


def test_the_same_noise_narrows_no_interval_of_heavy_tails():
    """Matched in rising order the upper bounds add up, which is less than that of a sum apart."""
    term = make_term(RunEstimate(1e-3, 0.5, 1.0))
    alone, alike = bound_sum([term]), bound_sum([term, replace(term, name="b")])
    assert alike.at_most > 3.0 * alone.at_most
    assert alike.at_least == pytest.approx(2.0 * alone.at_least, rel=CLOSE)


counted = st.builds(EventRate, st.integers(0, 500), st.floats(0.1, 1e4))
stated = st.builds(
    lambda value, down, up: Stated(value, value / down, value * up),
    st.floats(1e-6, 1e3),
    st.floats(1.0, 10.0),
    st.floats(1.0, 10.0),
)
shares = st.builds(
    lambda n, part: make_share(int(n * part), n), st.integers(1, 10**5), st.floats(0.0, 1.0)
)
estimates = st.builds(
    RunEstimate, st.floats(1e-9, 0.9), st.floats(0.01, 3.0), st.sampled_from([1.0, 3.0, inf])
)
suites = st.lists(
    st.tuples(counted | stated, shares | estimates, st.integers(1, 3)), min_size=1, max_size=4
)


@settings(max_examples=40)
@given(suite=suites, place=st.integers(0, 3))
def test_a_further_scenario_lowers_no_bound(suite, place):
    terms = [
        make_term(probability, exposure, f"scenario {at}", f"seed {seed}")
        for at, (exposure, probability, seed) in enumerate(suite)
    ]
    whole = bound_sum(terms)
    rest = bound_sum(terms[:place] + terms[place + 1 :])
    # Another order of a sum changes its last bits.
    for name in ("at_least", "at_most"):
        assert getattr(rest, name) <= getattr(whole, name) * (1.0 + 1e-12)
    assert rest.interval.low <= whole.interval.low * (1.0 + 1e-12)
    assert rest.interval.high <= whole.interval.high * (1.0 + 1e-12)


@settings(max_examples=20)
@given(suite=suites)
def test_the_order_of_scenarios_changes_nothing(suite):
    terms = [
        make_term(probability, exposure, f"scenario {at}", f"seed {seed}")
        for at, (exposure, probability, seed) in enumerate(suite)
    ]
    one, other = bound_sum(terms), bound_sum(terms[::-1])
    assert one.at_least <= one.at_most
    assert one.interval.low <= one.at_least
    assert one.at_most <= one.interval.high
    assert other.at_most == pytest.approx(one.at_most, rel=1e-12)
