"""Values of settings as people type them into a form, and back."""

import re
from typing import Any

import msgspec

NONE = "none"
"""Switches off what is on unless something else is said."""

WHOLE = re.compile(r"[+-]?[0-9]{1,19}")
NUMBER = re.compile(r"[+-]?([0-9]+\.?[0-9]*|\.[0-9]+)([eE][+-]?[0-9]{1,4})?")
EXPECTED = re.compile(r"Expected `(?P<kinds>[^`]+)`(?P<rest>[^.]*)")
KINDS = {
    "int": "a whole number",
    "float": "a number",
    "str": "text",
    "array": "a list",
    "object": "a table",
    "bool": "true or false",
}
BOUNDS = {
    " of length >= ": " of at least ",
    " of length <= ": " of at most ",
    " >= ": " of at least ",
    " <= ": " of at most ",
    " > ": " above ",
    " < ": " below ",
}


def read_number(text: str) -> int | float | str:
    """A number as it was typed; the text itself where it is none, for the check to refuse."""
    if WHOLE.fullmatch(text):
        return int(text)
    return float(text) if NUMBER.fullmatch(text) else text


def read_optional(text: str) -> int | float | str | None:
    """A number, or that there is none."""
    return None if text == NONE else read_number(text)


def read_list(text: str) -> list[int | float | str]:
    """Numbers or words with commas in between."""
    return [read_number(part.strip()) for part in text.split(",") if part.strip()]


def read_table(text: str) -> Any:
    """JSON; the text itself where it is none."""
    try:
        return msgspec.json.decode(text)
    except (msgspec.DecodeError, RecursionError):
        return text


def read_switch(text: str) -> bool | str:
    """Yes or no."""
    return {"true": True, "false": False}.get(text, text)


def read_word(text: str) -> str:
    """The text itself."""
    return text


def written(value: Any) -> str:
    """A value as it stands in a field."""
    if value is None:
        return NONE
    if isinstance(value, str):
        return value
    if isinstance(value, list | tuple) and not any(isinstance(part, dict) for part in value):
        return ", ".join(map(written, value))
    return msgspec.json.encode(value).decode()


def humane(problem: str) -> str:
    """A complaint about a type or a bound, in words: "A number of at most 1.0 is expected"."""
    match = EXPECTED.search(problem)
    if match is None:
        return problem[:1].upper() + problem[1:]
    kinds = [KINDS.get(kind.strip(), kind.strip()) for kind in match["kinds"].split("|")]
    wanted = " or ".join(kind for kind in kinds if kind != "null")
    rest = problem[match.start("rest") :].partition(", got")[0].rstrip(".").rstrip("`")
    for sign, words in BOUNDS.items():
        rest = rest.replace(sign, words)
    return f"{wanted[:1].upper()}{wanted[1:]}{rest} is expected."
