"""Figures: what is unknown is a dash, what is small keeps its digits."""

import pytest

from eigenfail.cli import figures
from eigenfail.values import Cost, Estimate, Interval, Rate


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0.00"),
        (12.0, "12.00"),
        (0.5, "0.50"),
        (0.023, "0.023"),
        (0.0000223, "0.000022"),
        (None, "–"),
        (float("inf"), "–"),
    ],
)
def test_money_keeps_two_significant_digits(value, text):
    assert figures.usd(value) == text


@pytest.mark.parametrize(
    ("value", "digits", "text"),
    [(1.234, 2, "1.23"), (1.25, 0, "1"), (None, 2, "–"), (float("nan"), 1, "–")],
)
def test_numbers_have_fixed_decimals(value, digits, text):
    assert figures.number(value, digits) == text


def test_a_rate_comes_with_its_interval():
    rate = Rate(value=0.5, k=5, n=10, interval=Interval(0.2366, 0.7634))
    assert figures.rate(rate) == "50.0 % [23.7, 76.3]"
    assert figures.rate(None) == "–"


def test_the_rate_of_no_failure_is_its_upper_bound():
    """By the rule of three, 3 / 2000 = 0.15 %."""
    none = Rate(value=0.0, k=0, n=2000, interval=Interval(0.0, 0.001497))
    assert figures.rate(none) == "≤ 0.15 % (0 of 2000)"


def test_a_probability_comes_with_its_interval_and_number_of_episodes():
    told = Estimate(
        by="subset simulation",
        episodes=9100,
        probability=3.65e-6,
        cv=0.2,
        interval=Interval(2.2e-6, 5.94e-6),
    )
    assert figures.probability(told) == "3.7e-06 [2.2e-06, 5.9e-06] (n = 9100)"
    refused = Estimate(by="importance sampling", episodes=9100, problem="Too few.")
    assert figures.probability(refused) == figures.probability(None) == "–"


@pytest.mark.parametrize(
    ("cost", "text"),
    [
        (Cost(1.0, 1.0, 0.25, Interval(0.1, 0.6), 0.1), "0.25 [0.10, 0.60]"),
        (Cost(1.0, 1.0, 0.25, None, 0.1), "0.25"),
        (Cost(1.0, 1.0, None, None, 10.5), "≥ 10.50"),
        (Cost(0.0, 0.0, None, None, None), "–"),
    ],
)
def test_cost_per_failure_is_never_infinite_or_zero_for_want_of_failures(cost, text):
    assert figures.cost_per_failure(cost) == text
