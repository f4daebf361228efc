"""The filter language: what it reads, and how it says what it cannot read."""

import contextlib

import pytest
from hypothesis import given
from hypothesis import strategies as st

from eigenfail.errors import InputError, InvalidValue, UnknownName
from eigenfail.filters import COLUMNS, LONGEST, ColumnKind, Condition, Operator, parse_filter

BELOW, ABOVE, EQUAL, UNEQUAL = Operator.BELOW, Operator.ABOVE, Operator.EQUAL, Operator.UNEQUAL


def test_conditions_are_joined_by_and():
    found = parse_filter("outcome = collision and severity>80 AND min_ttc_s < 1.5\n and seed!=-3")
    assert found == (
        Condition("outcome", EQUAL, "collision"),
        Condition("severity", ABOVE, 80.0),
        Condition("min_ttc_s", BELOW, 1.5),
        Condition("seed", UNEQUAL, -3),
    )


@pytest.mark.parametrize("nothing", ["", "   ", "\n"])
def test_an_empty_filter_is_no_condition(nothing):
    assert parse_filter(nothing) == ()


@pytest.mark.parametrize(
    ("text", "value"),
    [
        ("worker = worker-1", "worker-1"),
        ("worker = 'two words'", "two words"),
        ('worker = "it\'s and = < more"', "it's and = < more"),
        ("worker = ''", ""),
        ("digest = 3f", "3f"),
        ("has_scene = true", True),
        ("has_scene = false", False),
        ("seed = 9223372036854775807", 2**63 - 1),
        ("seed = 1234567890123456789", 1234567890123456789),
        ("steps = 1e2", 100),
        ("severity = +.5", 0.5),
    ],
)
def test_values_are_of_the_columns_kind(text, value):
    (found,) = parse_filter(text)
    assert found.value == value
    assert type(found.value) is type(value)


@pytest.mark.parametrize(
    ("text", "character", "words"),
    [
        ("severity > 80 or steps < 3", 15, "'and' must come before 'or steps < 3'"),
        ("(severity > 80)", 1, "before '(severity > 80)'"),
        ("severity > 80 and", 18, "the end"),
        ("severity", 9, "an operator must follow severity"),
        ("severity >", 11, "lacks its value"),
        ("severity > 'x", 12, "lacks its value"),
        ("severity > high", 12, "high is not a number"),
        ("severity > nan", 12, "nan is not a number"),
        ("severity > 1e999", 12, "not a number"),
        ("steps = 10.5", 9, "steps is an integer"),
        ("index = 9223372036854775808", 9, "too large"),
        ("index = 1e300", 9, "1e300 is too large"),
        ("outcome > safe", 11, "outcome has no order"),
        ("worker = 'a\x00b'", 10, "cannot be printed"),
    ],
)
def test_what_is_wrong_is_told_with_its_place(text, character, words):
    with pytest.raises(InvalidValue) as refusal:
        parse_filter(text)
    assert refusal.value.field == f"filter, character {character}"
    assert words in str(refusal.value)


@pytest.mark.parametrize(
    ("text", "character", "near"),
    [
        ("steps > 1 and sevrity > 80", 15, "severity"),
        ("outcome = colision", 11, "collision"),
        ("class = failure", 9, "planner_failure"),
        ("severity == 80", 10, "="),
        ("has_scene = ture", 13, "true"),
    ],
)
def test_unknown_names_are_told_with_near_ones(text, character, near):
    with pytest.raises(UnknownName, match=f"Did you mean '{near}'") as refusal:
        parse_filter(text)
    assert refusal.value.field == f"filter, character {character}"
    assert near in refusal.value.known


def test_a_filter_has_an_end():
    with pytest.raises(InvalidValue, match=f"more than {LONGEST}"):
        parse_filter("steps > 1 and " * LONGEST)


@given(st.text(alphabet="severity outcome=<>!'\"()and0123456789.-e\x00ß", max_size=40))
def test_whatever_is_written_is_read_or_refused(text):
    with contextlib.suppress(InputError):
        assert all(condition.column in COLUMNS for condition in parse_filter(text))


NUMBERS = st.floats(allow_nan=False, allow_infinity=False)


@given(name=st.sampled_from(sorted(COLUMNS)), sign=st.sampled_from(Operator), number=NUMBERS)
def test_numbers_are_read_as_they_were_written(name, sign, number):
    if COLUMNS[name].kind is ColumnKind.NUMBER:
        assert parse_filter(f"{name} {sign} {number!r}") == (Condition(name, sign, number),)
