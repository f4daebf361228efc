"""Campaigns before they are launched: changes from the command line, and what a check found."""

from collections.abc import Sequence
from typing import Any

import msgspec
from rich.text import Text

from eigenfail.errors import InvalidValue
from eigenfail.suites.changes import leaves, put, text
from eigenfail.wire.drafts import CampaignCheck


def read_values(given: Sequence[str]) -> dict[str, Any]:
    """Fields of a campaign from texts like settings.alpha=100; what is no JSON is text.

    Raises:
        InvalidValue: one is not of that form.
    """
    fields: dict[str, Any] = {}
    for each in given:
        path, equals, value = each.partition("=")
        if not (equals and all(path.split("."))):
            problem = f"'{each}' is not of the form FIELD=VALUE."
            raise InvalidValue("--set", problem, "Write it as settings.alpha=100.")
        fields = put(fields, tuple(path.split(".")), read_value(value))
    return fields


def read_value(value: str) -> Any:
    """A number, list or table, or the text itself."""
    try:
        return msgspec.json.decode(value)
    except msgspec.DecodeError:
        return value


def checked(found: CampaignCheck) -> Text:
    """What a check found, in words."""
    if found.spec is None:
        return Text("\n".join(f"{each.detail} {each.remedy}".strip() for each in found.problems))
    plain = leaves(msgspec.to_builtins(found.spec))
    lines = (f"  {'.'.join(path)} = {text(value)}" for path, value in plain)
    return Text("\n".join(("It can be launched, as:", *lines, *found.notes)))
