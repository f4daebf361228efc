"""The formatter: three digits everywhere, a dash for what is unknown, and intervals in brackets."""

import msgspec
import pytest
from hypothesis import given
from hypothesis import strategies as st

from eigenfail.presentation import figures
from eigenfail.presentation.tables import (
    FormattedCell,
    Table,
    TableColumn,
    format_cell,
    format_cost,
    format_line,
    transpose,
)
from eigenfail.values.estimates import Cost, Estimate, Interval, Rate


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0.00"),
        (12.0, "12.00"),
        (1234.5, "1,234.50"),
        (0.5, "0.500"),
        (0.023, "0.0230"),
        (0.0000223, "0.0000223"),
        (None, "–"),
        (float("inf"), "–"),
    ],
)
def test_money_keeps_three_significant_digits_and_two_decimals(value, text):
    assert figures.format_usd(value) == text


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"),
        (1.234, "1.23"),
        (-12.34, "−12.3"),
        (0.9996, "1.00"),
        (1234.56, "1,235"),
        (36.25, "36.3"),
        (-190.5, "−191"),
        (1234.5, "1,235"),
        (0.0009995, "0.00100"),
        (2_505_000.0, "2.51×10⁶"),
        (0.00051, "5.10×10⁻⁴"),
        (0.0009999, "0.00100"),
        (-2.5e7, "−2.50×10⁷"),
        (None, "–"),
        (float("nan"), "–"),
    ],
)
def test_numbers_have_three_significant_digits(value, text):
    assert figures.format_number(value) == text


@pytest.mark.parametrize(
    ("share", "text"), [(0.343, "34.3 %"), (0.0417, "4.17 %"), (1.0, "100 %"), (0.0, "0 %")]
)
def test_shares_are_in_percent(share, text):
    assert figures.format_share(share) == text


@pytest.mark.parametrize(
    ("seconds", "text"),
    [(0.25, "0.250 s"), (59.4, "59 s"), (192, "3 min 12 s"), (7322, "2 h 2 min"), (None, "–")],
)
def test_durations_have_two_units(seconds, text):
    assert figures.format_duration(seconds) == text


def test_signs_counts_and_nouns():
    assert (figures.format_signed(0.16), figures.format_signed(-0.5)) == ("+0.160", "−0.500")
    assert (figures.format_count(12_345), figures.format_count(None)) == ("12,345", "–")
    assert (figures.count_noun(1, "failure"), figures.count_noun(2, "failure")) == (
        "1 failure",
        "2 failures",
    )
    assert figures.put_minus_signs("-3.0, of -2, a-b, 1-2") == "−3.0, of −2, a-b, 1-2"


@pytest.mark.parametrize(
    ("low", "high", "text"),
    [
        (0.30771, 0.30779, "[0.307, 0.308]"),
        (-0.05721, -0.01951, "[−0.0573, −0.0195]"),
        (0.0, 0.001_496_7, "[0, 0.00150]"),
        (0.9936, 0.9999, "[0.993, 1.00]"),
        (2.9375e-5, 4.2499e-5, "[2.93×10⁻⁵, 4.25×10⁻⁵]"),
        (1234.4, 1_234_567.1, "[1,230, 1.24×10⁶]"),
        (0.07, 0.5, "[0.0700, 0.500]"),
    ],
)
def test_the_ends_of_an_interval_are_rounded_outwards(low, high, text):
    assert figures.format_interval(Interval(low, high)) == text


def test_outward_rounding_leaves_round_numbers_as_they_are():
    """100 * 0.07 is 7.000000000000001, whose next number of three digits is 7.01."""
    assert figures.format_percent_interval(Interval(0.07, 0.07)) == "[7.00, 7.00] %"
    assert figures.format_percent_interval(Interval(0.0, 1.0)) == "[0, 100] %"
    assert figures.round_down(float("-inf")) == float("-inf")


@given(st.floats(-1e9, 1e9).filter(lambda value: abs(value) > 1e-9), st.integers(2, 6))
def test_what_is_rounded_outwards_contains_the_value_and_little_more(value, digits):
    low, high = figures.round_down(value, digits), figures.round_up(value, digits)
    assert low - 1e-10 * abs(value) <= value <= high + 1e-10 * abs(value)
    assert high - low <= 1.01 * 10.0 ** (1 - digits) * abs(value)
    assert figures.round_up(-value, digits) == -low


def test_shares_and_amounts_are_bounded_outwards():
    assert figures.format_upper_bound(0.007_461) == "≤ 0.747 %"
    assert figures.format_usd_interval(Interval(0.00123456, 12.345)) == "[0.00123, 12.35]"
    assert figures.format_usd_interval(Interval(1234.567, 2345.671)) == "[1,234.56, 2,345.68]"
    assert figures.format_signed_interval(Interval(-0.11111, 0.15151)) == "[−0.112, +0.152]"


def test_a_rate_comes_with_its_interval():
    rate = Rate(value=0.5, k=5, n=10, interval=Interval(0.2366, 0.7634))
    assert format_line(rate) == "50.0 % [23.6, 76.4]"
    assert format_line(None) == "–"


def test_the_rate_of_no_failure_is_its_upper_bound():
    """By the rule of three, 3 / 2000 = 0.15 %."""
    none = Rate(value=0.0, k=0, n=2000, interval=Interval(0.0, 0.001497))
    assert format_line(none) == "≤ 0.150 % (0 of 2,000)"
    assert format_cell(none).notes == ("0 of 2,000", "95 % upper bound")


def test_a_probability_comes_with_its_interval_and_number_of_episodes():
    told = Estimate(
        by="subset simulation",
        episodes=9100,
        probability=3.65e-6,
        cv=0.2,
        interval=Interval(2.2e-6, 5.94e-6),
    )
    assert format_line(told) == "3.65×10⁻⁶ [2.20×10⁻⁶, 5.94×10⁻⁶] (n = 9,100)"
    assert format_cell(told).basis == ("by subset simulation, cv 0.200",)
    bound = Estimate(by="sampling", episodes=600, probability=1.2e-5, note="Why.", bound="lower")
    basis = ("n = 600", "lower bound without a confidence level", "by sampling", "Why.")
    assert format_cell(bound).lines == ("at least 1.20×10⁻⁵", *basis)
    refused = Estimate(by="importance sampling", episodes=9100, problem="Too few.")
    assert format_cell(refused) == FormattedCell("–", basis=("by importance sampling", "Too few."))


@pytest.mark.parametrize(
    ("cost", "text"),
    [
        (Cost(1.0, 1.0, 0.25, Interval(0.1, 0.6), 0.1), "0.250 [0.100, 0.600]"),
        (Cost(1.0, 1.0, 0.25, None, 0.1), "0.250 [0.100, ∞)"),
        (Cost(1.0, 1.0, 0.25, None, None), "0.250"),
        (Cost(1.0, 1.0, None, None, 10.5), "≥ 10.50"),
        (Cost(0.0, 0.0, None, None, None), "–"),
    ],
)
def test_cost_per_failure_is_never_infinite_or_zero_for_want_of_failures(cost, text):
    assert format_line(cost) == text


@pytest.mark.parametrize(("k", "text"), [(347, "86.8 % of its search"), (0, "0 % of its search")])
def test_a_share_of_the_episodes_of_a_search_has_no_interval(k, text):
    share = Rate(k / 400, k, 400, Interval(0.0, 0.9), sampled=False)
    assert share.interval is None
    assert format_cell(share).lines == (text,)
    assert Rate(k / 400, k, 400, Interval(0.0, 0.9)).interval == Interval(0.0, 0.9)


def test_a_share_of_a_search_that_an_earlier_release_sent_is_read_without_its_interval():
    sent = {"value": 0.25, "k": 1, "n": 4, "interval": {"low": 0.04, "high": 0.71}}
    of_a_search = msgspec.convert({**sent, "sampled": False}, Rate)
    assert of_a_search == Rate(0.25, 1, 4, None, sampled=False)
    assert msgspec.to_builtins(of_a_search)["interval"] is None
    assert msgspec.convert(sent, Rate).interval == Interval(0.04, 0.71)


def test_a_cost_outside_a_table_has_its_unit():
    known = Cost(1.0, 1.0, 0.5, Interval(0.25, 1.0), 0.25)
    assert format_cost(known).lines == ("0.500 USD", "95 %: [0.250, 1.00] USD")
    bound = Cost(1.0, 1.0, None, None, 0.25)
    assert format_cost(bound).lines == ("≥ 0.250 USD", "95 % lower bound")
    nothing = Cost(0.0, 0.0, None, None, None)
    assert format_cost(nothing).lines == ("–", "no failure")


def test_times_are_in_utc():
    assert figures.format_utc(0) == "1970-01-01 00:00:00 UTC"
    assert figures.format_utc(None) == "–"


def test_a_table_stands_on_its_side():
    columns = (TableColumn("Campaign"), TableColumn("Share", "share"), TableColumn("Gap", "m"))
    turned = transpose(Table("Results", columns, (("1", 0.5, 2.0), ("2", 0.25, None))))
    assert [column.title for column in turned.columns] == ["", "1", "2"]
    texts = [[cell.line for cell in row] for row in turned.cells]
    assert texts == [["Share", "50.0 %", "25.0 %"], ["Gap [m]", "2.00", "–"]]
