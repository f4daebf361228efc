"""What is wrong with a parameter, in words of this project."""

from collections.abc import Mapping
from typing import Any

from eigenfail_api.parameters import FORMS

WORDS = {
    "missing": "is required.",
    "int_parsing": "{input!r} is no whole number.",
    "float_parsing": "{input!r} is no number.",
    "bool_parsing": "{input!r} is neither true nor false.",
    "greater_than": "{input} is not above {gt:g}.",
    "greater_than_equal": "{input} is below {ge}.",
    "less_than": "{input} is not below {lt:g}.",
    "less_than_equal": "{input} is above {le}.",
    "enum": "{input!r} is not one of {expected}.",
    "string_too_short": "is empty.",
    "string_too_long": "is longer than {max_length} characters.",
    "string_pattern_mismatch": "{input!r} is not {form}.",
}
"""By the framework's name of the error; it fills in what was given, and the bound."""

SHOWN = 60
"""Most characters that are shown of what was given."""


def told(error: Mapping[str, Any]) -> str:
    """One of the framework's errors as a sentence; its own words where there are none of ours."""
    words = WORDS.get(error["type"], "{msg}.")
    given = error["input"]
    shown = given if not isinstance(given, str) else given[:SHOWN]
    bounds = error.get("ctx", {})
    form = FORMS.get(bounds.get("pattern", ""), "of the form that it must have")
    return words.format_map({**bounds, "input": shown, "form": form, "msg": error["msg"]})
