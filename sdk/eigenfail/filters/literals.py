"""The value of a condition: of its column's kind, or a sentence on what it should have been."""

from collections.abc import Callable
from math import isfinite

import msgspec

from eigenfail.errors import InvalidValue, UnknownName
from eigenfail.filters.columns import Column, Kind, Value
from eigenfail.filters.conditions import Operator

LARGEST = 2**63 - 1
"""No whole number of an episode is larger."""

FLAGS = {"true": True, "false": False}
WITHOUT_ORDER = (Operator.EQUAL, Operator.UNEQUAL)


class Place(msgspec.Struct, frozen=True):
    """Where something stands in a filter; the first character is 1."""

    character: int

    @property
    def field(self) -> str:
        """As errors name it."""
        return f"filter, character {self.character}"


def value_in(column: Column, sign: Operator, word: str, place: Place) -> Value:
    """The value that a word stands for beside a column.

    Raises:
        InvalidValue: it is of another kind, or the operator asks for an order that there is not.
        UnknownName: the column never has this value.
    """
    if not column.is_ordered and sign not in WITHOUT_ORDER:
        remedy = "Compare it by = or !=."
        raise InvalidValue(place.field, f"{column.name} has no order for {sign}.", remedy)
    return READ[column.kind](column, word, place)


def number(column: Column, word: str, place: Place) -> Value:
    """A number."""
    try:
        value = float(word)
    except ValueError:
        value = float("nan")
    if not isfinite(value):
        raise InvalidValue(
            place.field, f"{word} is no number, as {column.name} is.", "Write it like 80 or 1.5."
        )
    return value


def whole(column: Column, word: str, place: Place) -> Value:
    """A whole number that 64 bits hold."""
    value = number(column, word, place)
    if value != int(value):
        problem = f"{column.name} is a whole number, which {word} is not."
        raise InvalidValue(place.field, problem, "Leave the fraction away.")
    # A float would not hold every digit of a seed.
    exact = int(word) if word.lstrip("+-").isdecimal() else int(value)
    if abs(exact) > LARGEST:
        raise InvalidValue(place.field, f"{word} is too large for {column.name}.")
    return exact


def text(column: Column, word: str, place: Place) -> Value:
    """A word, or what stands between quotes."""
    bare = word[1:-1] if word[0] in "\"'" else word
    if not bare.isprintable():
        raise InvalidValue(place.field, "there is a character that cannot be printed.")
    if column.choices and bare not in column.choices:
        raise UnknownName(place.field, bare, column.choices)
    return bare


def flag(_column: Column, word: str, place: Place) -> Value:
    """True or false."""
    if word not in FLAGS:
        raise UnknownName(place.field, word, FLAGS)
    return FLAGS[word]


READ: dict[Kind, Callable[[Column, str, Place], Value]] = {
    Kind.NUMBER: number,
    Kind.WHOLE: whole,
    Kind.TEXT: text,
    Kind.FLAG: flag,
}
