"""Which episodes are wanted, in which order, and what of them: a small language."""

from eigenfail.filters.columns import COLUMNS, Column, Kind, Value, value_of
from eigenfail.filters.conditions import (
    COMPARE,
    Condition,
    Conditions,
    Operator,
    matches,
    outcome_is,
)
from eigenfail.filters.parser import parse_filter
from eigenfail.filters.sorting import BY_INDEX, WORST_FIRST, Sort, parse_fields, parse_sort

__all__ = [
    "BY_INDEX",
    "COLUMNS",
    "COMPARE",
    "WORST_FIRST",
    "Column",
    "Condition",
    "Conditions",
    "Kind",
    "Operator",
    "Sort",
    "Value",
    "matches",
    "outcome_is",
    "parse_fields",
    "parse_filter",
    "parse_sort",
    "value_of",
]
