"""From a filter's text to conditions, or to a sentence on what is wrong and where.

filter    = [ condition { "and" condition } ]
condition = column operator value
value     = number | word | "text" | 'text' | true | false
"""

import re

from eigenfail.errors import InvalidValue, UnknownName
from eigenfail.filters.columns import COLUMNS
from eigenfail.filters.conditions import Condition, Conditions, Operator
from eigenfail.filters.literals import Place, value_in

LONGEST = 2_000
"""How many characters a filter may have."""

SPACE = re.compile(r"\s*")
NAME = re.compile(r"\w+")
SIGNS = re.compile(r"[=!<>~]+|:")
VALUE = re.compile(r"\"[^\"]*\"|'[^']*'|[^\s\"'<>=!()]+")
SHOWN = 24


def parse_filter(text: str) -> Conditions:
    """The conditions that a filter consists of; none if it is empty.

    Raises:
        UnknownName: a column or a value that there is not; known and near ones are told.
        InvalidValue: anything else that is wrong, with the character where it is.
    """
    if len(text) > LONGEST:
        raise InvalidValue("filter", f"it has {len(text)} characters, more than {LONGEST}.")
    reader = Reader(text)
    conditions: list[Condition] = []
    while not reader.at_end:
        if conditions:
            reader.conjunction()
        conditions.append(reader.condition())
    return tuple(conditions)


class Reader:
    """Goes through a filter, one word after the other."""

    def __init__(self, text: str) -> None:
        self._text = text
        self._at = 0

    @property
    def at_end(self) -> bool:
        """Whether nothing but space is left."""
        self._skip()
        return self._at == len(self._text)

    def conjunction(self) -> None:
        """The `and` between two conditions."""
        word = self._take(NAME)
        if word is None or word.lower() != "and":
            remedy = "Join conditions by and; there is no or, and there are no parentheses."
            raise self._wrong(f"'and' must come before {self._found(word)}.", remedy, word)

    def condition(self) -> Condition:
        """One condition."""
        name = self._take(NAME)
        if name is None:
            remedy = "Write column, operator, value, such as severity > 80."
            raise self._wrong(f"the name of a column is missing before {self._found()}.", remedy)
        if name not in COLUMNS:
            raise UnknownName(self._place(name).field, name, COLUMNS)
        sign = self._operator(name)
        word = self._take(VALUE)
        if word is None:
            remedy = "Write a number, a word, or text in quotes."
            raise self._wrong(f"{name} {sign} lacks its value.", remedy)
        value = value_in(COLUMNS[name], sign, word, self._place(word))
        return Condition(name, sign, value)

    def _operator(self, name: str) -> Operator:
        signs = self._take(SIGNS)
        if signs is None:
            known = ", ".join(Operator)
            raise self._wrong(f"an operator must follow {name}.", f"Known: {known}.")
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

    def _place(self, taken: str | None = None) -> Place:
        return Place(self._at - len(taken or "") + 1)

    def _found(self, taken: str | None = None) -> str:
        rest = self._text[self._at - len(taken or "") :][:SHOWN]
        return f"'{rest}'" if rest else "the end"

    def _wrong(self, problem: str, remedy: str, taken: str | None = None) -> InvalidValue:
        return InvalidValue(self._place(taken).field, problem, remedy)
