"""What was typed into a form: texts by field, read as the fields of a campaign."""

from collections.abc import Callable, Iterable, Mapping
from typing import Any

import msgspec

from eigenfail.suites.changes import put, value_at
from eigenfail_api.dashboard.views.launch_fields import Field
from eigenfail_api.dashboard.views.launch_texts import (
    read_list,
    read_number,
    read_optional,
    read_switch,
    read_table,
    read_word,
    written,
)

HOW, LOW, HIGH, CHOICES = ".how", ".low", ".high", ".choices"
FIXED, UNIFORM, CHOICE = "fixed", "uniform", "choice"

READERS: Mapping[str, Callable[[str], Any]] = {
    "number": read_number,
    "varied": read_number,
    "text": read_word,
    "choice": read_word,
    "optional": read_optional,
    "switch": read_switch,
    "list": read_list,
    "table": read_table,
}


class Entry(msgspec.Struct, frozen=True, kw_only=True):
    """What stands in a field.

    Attributes:
        text: as it was typed.
        how: fixed, or drawn from which distribution.
        low: smallest value of a uniform distribution; high: its largest.
        choices: the values of a choice, with commas in between.
    """

    text: str = ""
    how: str = FIXED
    low: str = ""
    high: str = ""
    choices: str = ""


class Texts(msgspec.Struct, frozen=True):
    """What was typed, and below it the fields of the campaign that it began with.

    Attributes:
        typed: by the name of the form's element.
        base: fields of a CampaignSpec; empty where the form began empty.
    """

    typed: Mapping[str, str]
    base: Mapping[str, Any]

    def entry(self, field: Field) -> Entry:
        """What stands in a field: what was typed, or what it began with."""
        name = field.name
        if name not in self.typed and name + HOW not in self.typed:
            return self._began_with(field)
        get = self.typed.get
        return Entry(
            text=get(name, "").strip(),
            how=get(name + HOW, FIXED),
            low=get(name + LOW, "").strip(),
            high=get(name + HIGH, "").strip(),
            choices=get(name + CHOICES, "").strip(),
        )

    def _began_with(self, field: Field) -> Entry:
        *above, label = field.name.split(".")
        table = value_at(dict(self.base), tuple(above)) if above else self.base
        if not isinstance(table, Mapping) or label not in table:
            return Entry()
        if table[label] is None and field.kind != "optional":
            return Entry()
        return as_entry(table[label])


def as_entry(value: Any) -> Entry:
    """A value of an earlier campaign as it stands in a field."""
    match value:
        case {"uniform": [low, high]}:
            return Entry(how=UNIFORM, low=written(low), high=written(high))
        case {"choice": [*values]}:
            return Entry(how=CHOICE, choices=written(values))
    return Entry(text=written(value))


def body_of(fields: Iterable[Field], texts: Texts) -> dict[str, Any]:
    """The fields of a campaign, as a launch is asked for with; what is empty is left out."""
    body: dict[str, Any] = {}
    for field in fields:
        given = value_of(field, texts.entry(field))
        if given:
            body = put(body, tuple(field.name.split(".")), given[0])
    return body


def value_of(field: Field, entry: Entry) -> tuple[Any, ...]:
    """The value of a field; nothing where nothing is typed."""
    if entry.how == UNIFORM:
        return ({"uniform": [read_number(entry.low), read_number(entry.high)]},)
    if entry.how == CHOICE:
        return ({"choice": read_list(entry.choices)},)
    if not entry.text:
        return ()
    return (READERS[field.kind](entry.text),)


def in_words(entry: Entry) -> str:
    """What stands in a field, for comparison with what it began with."""
    if entry.how == UNIFORM:
        return f"uniform {entry.low} … {entry.high}"
    return f"one of {entry.choices}" if entry.how == CHOICE else entry.text
