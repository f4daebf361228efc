"""Filters, sort orders and columns of the list of episodes.

A filter is a conjunction of conditions:

    filter    = [ condition { "and" condition } ]
    condition = column operator value
    value     = number | word | "text" | 'text' | true | false
"""

import operator
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from enum import StrEnum
from itertools import starmap
from math import isfinite
from typing import Any

import msgspec

from eigenfail.errors import InvalidValue, UnknownName
from eigenfail.settings import LARGEST_INTEGER
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.episode import Outcome
from eigenfail.values.measures import MEASURES, Measure
from eigenfail.values.records import LEAD_TIMES, ConflictClass, EpisodeRow
from eigenfail.values.requirements import MOST_REQUIREMENTS

Value = int | float | str | bool


class ColumnKind(StrEnum):
    """Type of a column; only numbers have an order."""

    NUMBER = "number"
    WHOLE = "whole number"
    TEXT = "text"
    FLAG = "true or false"


class Column(msgspec.Struct, frozen=True):
    """A column of the list of episodes.

    Attributes:
        name: name in filters, sorts, fields and files.
        kind: type of its values.
        words: description, with the unit.
        choices: the permitted values of a text; empty if any text is.
        stored: the stored value of a choice that users know by another word.
    """

    name: str
    kind: ColumnKind
    words: str
    choices: tuple[str, ...] = ()
    stored: Mapping[str, str] = {}

    @property
    def is_ordered(self) -> bool:
        """True if episodes can be sorted by this column."""
        return self.kind in {ColumnKind.NUMBER, ColumnKind.WHOLE}


STORED_OUTCOMES = {each.word: each.value for each in Outcome if each.word != each.value}

N, W, T = ColumnKind.NUMBER, ColumnKind.WHOLE, ColumnKind.TEXT


def _measure_column(name: str, measure: Measure) -> Column:
    kind = T if measure.is_text else W if measure.is_count else N
    return Column(name, kind, measure.description)


_COLUMNS_AFTER_MEASURES = {
    "robustness_m": (
        Column("log_probability", N, "sum of log p(a_t)"),
        Column("log_probability_per_step", N, "the same by its steps"),
    ),
    "drac_at_warning_mps2": tuple(starmap(_measure_column, LEAD_TIMES.items())),
}
"""Columns that follow a measure: exported files keep the order of their columns."""


def _list_measures() -> Iterator[Column]:
    for name, measure in MEASURES.items():
        yield _measure_column(name, measure)
        yield from _COLUMNS_AFTER_MEASURES.get(name, ())


_COLUMNS = (
    Column("campaign", W, "id of its campaign"),
    Column("index", W, "its number within the campaign, from 0"),
    Column("seed", W, "of everything random in it"),
    Column("outcome", T, "how it ended", tuple(each.word for each in Outcome), STORED_OUTCOMES),
    Column("class", T, "conflict class", tuple(ConflictClass)),
    Column("steps", W, "steps until it ended"),
    Column("source", T, "where its disturbances come from: prior, trajectory or policy"),
    Column("worker", T, "worker that ran it"),
    *_list_measures(),
    Column("wall_s", N, "time that the worker spent on it [s]"),
    Column("finished_ms", W, "when its result was stored [ms since 1970]"),
    Column("digest", T, "SHA-256 of what happened"),
    Column("has_scene", ColumnKind.FLAG, "whether its scene was kept"),
    Column("problem", T, "why it errored"),
    Column("mode", W, "failure mode in the newest analysis of its campaign, from 1"),
)

COLUMNS = {column.name: column for column in _COLUMNS}
"""Columns of every campaign, by name; see `find_column` for those of requirements."""

_REQUIREMENT = re.compile(r"requirement_([1-9][0-9]?)")
_KNOWN = (*COLUMNS, "requirement_1")
"""Names that an error offers; the last one stands for all requirements."""


def find_requirement(column: str) -> int | None:
    """Return the number, from 1, of the requirement whose robustness a column holds; else None."""
    found = _REQUIREMENT.fullmatch(column)
    number = int(found[1]) if found else 0
    return number if 1 <= number <= MOST_REQUIREMENTS else None


def find_column(name: str, field: str) -> Column:
    """Return a column by its name.

    Args:
        name: one of `COLUMNS`, or `requirement_` and the number of a requirement, from 1.
        field: field that has the name, for the error.

    Raises:
        UnknownName: the column does not exist.
    """
    if name in COLUMNS:
        return COLUMNS[name]
    if (number := find_requirement(name)) is None:
        raise UnknownName(field, name, _KNOWN)
    words = f"robustness of requirement {number} of the campaign, in the unit of that requirement"
    return Column(name, N, words)


def list_columns(spec: CampaignSpec) -> tuple[str, ...]:
    """Return the names of all columns that the episodes of a campaign have."""
    judged = range(1, len(spec.named_requirements) + 1)
    return (*COLUMNS, *(f"requirement_{number}" for number in judged))


_VALUE_READERS: dict[str, Callable[[EpisodeRow], Value | None]] = {
    "class": lambda row: row.assessed.conflict,
    "ttc_lead_s": lambda row: row.assessed.ttc_lead_s,
    "drac_lead_s": lambda row: row.assessed.drac_lead_s,
    "log_probability_per_step": lambda row: row.log_probability / max(row.steps, 1),
    "problem": lambda row: row.problem or None,
}
"""How to read the columns that are not fields of a row."""


def read_value(row: EpisodeRow, column: str) -> Value | None:
    """Return the value of a column in a row; None if it was not measured."""
    if column in _VALUE_READERS:
        return _VALUE_READERS[column](row)
    if column in COLUMNS:  # before a pattern is matched: files have thirty cells a row
        value: Value | None = getattr(row, column)
        return value
    number = find_requirement(column)
    judged = row.requirements
    return judged[number - 1] if number is not None and number <= len(judged) else None


class Operator(StrEnum):
    """Comparison of a column with a value."""

    EQUAL = "="
    UNEQUAL = "!="
    BELOW = "<"
    AT_MOST = "<="
    ABOVE = ">"
    AT_LEAST = ">="


COMPARE: dict[Operator, Callable[[Any, Any], Any]] = {
    Operator.EQUAL: operator.eq,
    Operator.UNEQUAL: operator.ne,
    Operator.BELOW: operator.lt,
    Operator.AT_MOST: operator.le,
    Operator.ABOVE: operator.gt,
    Operator.AT_LEAST: operator.ge,
}


class Condition(msgspec.Struct, frozen=True):
    """A column, an operator, and a value of the column's kind."""

    column: str
    operator: Operator
    value: Value

    def holds(self, row: EpisodeRow) -> bool:
        """Return whether a row fulfils the condition; False for a missing value."""
        value = read_value(row, self.column)
        return value is not None and bool(COMPARE[self.operator](value, self.value))


Conditions = tuple[Condition, ...]
"""Conditions that must all hold; no condition selects every episode."""


def make_outcome_condition(outcome: Outcome | None) -> Conditions:
    """Return the condition for an outcome; empty for None."""
    return () if outcome is None else (Condition("outcome", Operator.EQUAL, outcome.value),)


def write_failure_filter(spec: CampaignSpec) -> str:
    """Return the filter that selects the failures of a campaign."""
    return "violated >= 1" if spec.named_requirements else "outcome = collision"


FLAGS = {"true": True, "false": False}
WITHOUT_ORDER = (Operator.EQUAL, Operator.UNEQUAL)


class _Place(msgspec.Struct, frozen=True):
    """Position in a filter; the first character is 1."""

    character: int

    @property
    def field(self) -> str:
        """Name of the position in error messages."""
        return f"filter, character {self.character}"


def _read_operand(column: Column, sign: Operator, word: str, place: _Place) -> Value:
    """Convert the operand of a condition to the type of its column.

    Raises:
        InvalidValue: the operand has another type, or the operator needs an order.
        UnknownName: the column never has this value.
    """
    if not column.is_ordered and sign not in WITHOUT_ORDER:
        remedy = "Compare it by = or !=."
        raise InvalidValue(place.field, f"{column.name} has no order for {sign}.", remedy)
    return _OPERAND_READERS[column.kind](column, word, place)


def _read_number(column: Column, word: str, place: _Place) -> Value:

    try:
        value = float(word)
    except ValueError:
        value = float("nan")
    if not isfinite(value):
        raise InvalidValue(
            place.field,
            f"{word} is not a number, but {column.name} is.",
            "Write it like 80 or 1.5.",
        )
    return value


def _read_whole_number(column: Column, word: str, place: _Place) -> Value:

    value = _read_number(column, word, place)
    if value != int(value):
        problem = f"{column.name} is an integer, but {word} is not."
        raise InvalidValue(place.field, problem, "Omit the fraction.")
    # A float would not hold every digit of a seed.
    exact = int(word) if word.lstrip("+-").isdecimal() else int(value)
    if abs(exact) > LARGEST_INTEGER:
        raise InvalidValue(place.field, f"{word} is too large for {column.name}.")
    return exact


def _read_text(column: Column, word: str, place: _Place) -> Value:

    bare = word[1:-1] if word[0] in "\"'" else word
    if not bare.isprintable():
        raise InvalidValue(place.field, "the text contains a character that cannot be printed.")
    known = {*column.choices, *column.stored.values()}
    if column.choices and bare not in known:
        raise UnknownName(place.field, bare, column.choices)
    return column.stored.get(bare, bare)


def _read_flag(_column: Column, word: str, place: _Place) -> Value:

    if word not in FLAGS:
        raise UnknownName(place.field, word, FLAGS)
    return FLAGS[word]


_OPERAND_READERS: dict[ColumnKind, Callable[[Column, str, _Place], Value]] = {
    ColumnKind.NUMBER: _read_number,
    ColumnKind.WHOLE: _read_whole_number,
    ColumnKind.TEXT: _read_text,
    ColumnKind.FLAG: _read_flag,
}


LONGEST = 2_000
"""Largest number of characters of a filter."""

SPACE = re.compile(r"\s*")
NAME = re.compile(r"\w+")
SIGNS = re.compile(r"[=!<>~]+|:")
VALUE = re.compile(r"\"[^\"]*\"|'[^']*'|[^\s\"'<>=!()]+")
SHOWN = 24


def parse_filter(text: str) -> Conditions:
    """Parse a filter into conditions; an empty filter has none.

    Raises:
        UnknownName: a column or a value does not exist; the error names known and similar ones.
        InvalidValue: any other mistake, with the position of its character.
    """
    if len(text) > LONGEST:
        raise InvalidValue("filter", f"it has {len(text)} characters, more than {LONGEST}.")
    reader = _FilterReader(text)
    conditions: list[Condition] = []
    while not reader.at_end:
        if conditions:
            reader.read_conjunction()
        conditions.append(reader.read_condition())
    return tuple(conditions)


class _FilterReader:
    """Reads a filter word by word."""

    def __init__(self, text: str) -> None:
        self._text = text
        self._at = 0

    @property
    def at_end(self) -> bool:
        """Return whether only white space is left."""
        self._skip()
        return self._at == len(self._text)

    def read_conjunction(self) -> None:
        """Read the `and` between two conditions."""
        word = self._take(NAME)
        if word is None or word.lower() != "and":
            remedy = "Join conditions by and; there is no or, and there are no parentheses."
            raise self._make_error(f"'and' must come before {self._show_rest(word)}.", remedy, word)

    def read_condition(self) -> Condition:
        """Read a condition."""
        name = self._take(NAME)
        if name is None:
            remedy = "Write column, operator, value, such as severity > 80."
            raise self._make_error(
                f"the name of a column is missing before {self._show_rest()}.", remedy
            )
        column = find_column(name, self._place(name).field)
        sign = self._operator(name)
        word = self._take(VALUE)
        if word is None:
            remedy = "Write a number, a word, or text in quotes."
            raise self._make_error(f"{name} {sign} lacks its value.", remedy)
        return Condition(name, sign, _read_operand(column, sign, word, self._place(word)))

    def _operator(self, name: str) -> Operator:
        signs = self._take(SIGNS)
        if signs is None:
            known = ", ".join(Operator)
            raise self._make_error(f"an operator must follow {name}.", f"Known: {known}.")
        if signs not in list(Operator):
            raise UnknownName(self._place(signs).field, signs, Operator)
        return Operator(signs)

    def _take(self, pattern: re.Pattern[str]) -> str | None:
        self._skip()
        found = pattern.match(self._text, self._at)
        if found is None:
            return None
        self._at = found.end()
        return found[0]

    def _skip(self) -> None:
        if (space := SPACE.match(self._text, self._at)) is not None:
            self._at = space.end()

    def _place(self, taken: str | None = None) -> _Place:
        return _Place(self._at - len(taken or "") + 1)

    def _show_rest(self, taken: str | None = None) -> str:
        rest = self._text[self._at - len(taken or "") :][:SHOWN]
        return f"'{rest}'" if rest else "the end"

    def _make_error(self, problem: str, remedy: str, taken: str | None = None) -> InvalidValue:
        return InvalidValue(self._place(taken).field, problem, remedy)


ORDERED = tuple(name for name, column in COLUMNS.items() if column.is_ordered and name != "mode")
"""Columns that episodes can be sorted by. The mode of an episode changes with the next analysis:
pages in its order would not follow each other without gap or overlap."""


class SortOrder(msgspec.Struct, frozen=True):
    """Order by a column, then by index, both in the same direction.

    Rows without a value come last in both directions.
    """

    column: str = "index"
    descending: bool = False

    def __str__(self) -> str:
        """Return the column, with a minus in front if the largest come first."""
        return f"-{self.column}" if self.descending else self.column


BY_INDEX = SortOrder()
WORST_FIRST = SortOrder("severity", descending=True)


def parse_sort(text: str) -> SortOrder:
    """Parse a sort order: a column, or -column for the largest values first.

    Raises:
        UnknownName: the column does not exist, or cannot be sorted.
    """
    name = text.strip().removeprefix("-")
    if name not in ORDERED and find_requirement(name) is None:
        raise UnknownName("sort", name, ORDERED)
    return SortOrder(name, text.strip().startswith("-"))


CAMPAIGN_ORDERS = (
    "id",
    "name",
    "planner",
    "method",
    "state",
    "failures",
    "completed",
    "cost_per_failure_usd",
)
"""What campaigns can be sorted by."""

NEWEST_FIRST = SortOrder("id", descending=True)


def parse_campaign_sort(text: str) -> SortOrder:
    """Parse an order of campaigns: one of `CAMPAIGN_ORDERS`, with a minus for the largest first.

    Raises:
        UnknownName: campaigns cannot be sorted by it.
    """
    name = text.strip().removeprefix("-")
    if name not in CAMPAIGN_ORDERS:
        raise UnknownName("sort", name, CAMPAIGN_ORDERS)
    return SortOrder(name, text.strip().startswith("-"))


def parse_fields(text: str | Sequence[str]) -> tuple[str, ...]:
    """Parse names of columns, separated by commas or in a sequence; no name selects all.

    Raises:
        UnknownName: a column does not exist.
        InvalidValue: a column is named twice.
    """
    parts = text.split(",") if isinstance(text, str) else text
    names = tuple(name for part in parts if (name := part.strip()))
    for name in names:
        find_column(name, "fields")
        if names.count(name) > 1:
            raise InvalidValue("fields", f"{name} is named twice.")
    return names
