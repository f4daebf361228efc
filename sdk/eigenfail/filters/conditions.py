"""Conditions on episodes: frozen, and the same for every store."""

import operator
from collections.abc import Callable, Iterable
from enum import StrEnum
from typing import Any

import msgspec

from eigenfail.filters.columns import Value, value_of
from eigenfail.values.episode import Outcome
from eigenfail.values.records import EpisodeRow


class Operator(StrEnum):
    """How a column is held against a value."""

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
        """Whether a row fulfils it; what is missing never does."""
        value = value_of(row, self.column)
        return value is not None and bool(COMPARE[self.operator](value, self.value))


Conditions = tuple[Condition, ...]
"""All of them have to hold; none at all is every episode."""


def matches(row: EpisodeRow, conditions: Iterable[Condition]) -> bool:
    """Whether a row fulfils all conditions."""
    return all(condition.holds(row) for condition in conditions)


def outcome_is(outcome: Outcome | None) -> Conditions:
    """The condition that episodes ended like this; none if any outcome will do."""
    return () if outcome is None else (Condition("outcome", Operator.EQUAL, outcome.value),)
