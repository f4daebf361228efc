"""In which order episodes are wanted, and which columns of them."""

from collections.abc import Sequence

import msgspec

from eigenfail.errors import InvalidValue, UnknownName
from eigenfail.filters.columns import COLUMNS

ORDERED = tuple(name for name, column in COLUMNS.items() if column.is_ordered)


class Sort(msgspec.Struct, frozen=True):
    """By a column, and where its values are the same by index, both in one direction.

    Rows without a value come last in both directions.
    """

    column: str = "index"
    descending: bool = False

    def __str__(self) -> str:
        """As it is written: the column, behind a minus if the largest come first."""
        return f"-{self.column}" if self.descending else self.column


BY_INDEX = Sort()
WORST_FIRST = Sort("severity", descending=True)


def parse_sort(text: str) -> Sort:
    """The order that a text stands for: a column, or -column for the largest first.

    Raises:
        UnknownName: no such column, or one without an order.
    """
    name = text.strip().removeprefix("-")
    if name not in ORDERED:
        raise UnknownName("sort", name, ORDERED)
    return Sort(name, text.strip().startswith("-"))


def parse_fields(text: str | Sequence[str]) -> tuple[str, ...]:
    """Names of columns, with commas in between or in a sequence; none stand for all.

    Raises:
        UnknownName: no such column.
        InvalidValue: one is named twice.
    """
    parts = text.split(",") if isinstance(text, str) else text
    names = tuple(name for part in parts if (name := part.strip()))
    for name in names:
        if name not in COLUMNS:
            raise UnknownName("fields", name, COLUMNS)
        if names.count(name) > 1:
            raise InvalidValue("fields", f"{name} is named twice.")
    return names
