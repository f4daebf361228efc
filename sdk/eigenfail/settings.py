"""Settings of plug-ins: typed, bounded, and refused by name where they are wrong."""

import re
from collections.abc import Mapping
from typing import Any, TypeVar

import msgspec

from eigenfail.errors import EigenfailError, InvalidValue, UnknownName, describe_error

Kind = TypeVar("Kind", bound=msgspec.Struct)

PATH = re.compile(r" - at `\$\.?(?P<path>[^`]*)`")


def read_settings(kind: type[Kind], given: Mapping[str, Any], field: str) -> Kind:
    """The settings of a plug-in from what a user gave, its defaults filling the rest.

    Args:
        kind: a frozen struct whose annotations carry the bounds.
        given: names and values as the user wrote them.
        field: where they stood, for the error.

    Raises:
        UnknownName: a setting that the plug-in does not have.
        InvalidValue: a value of the wrong type or outside its bounds, or one at which the plug-in
            raises.
    """
    known = kind.__struct_fields__
    for name in given:
        if name not in known:
            raise UnknownName(field, str(name), known)
    try:
        return convert(dict(given), kind, field)
    except EigenfailError:
        raise
    except Exception as error:  # a plug-in's `__post_init__` may raise anything
        problem = f"The settings are refused with {describe_error(error)}."
        raise InvalidValue(field, problem, "Check the settings of the plug-in.") from error


def defaults_of(kind: type[msgspec.Struct]) -> dict[str, Any]:
    """What the fields of a struct are unless they are given, as plain data; required ones aside."""
    found: dict[str, Any] = {}
    for field in msgspec.structs.fields(kind):
        if field.default is not msgspec.NODEFAULT:
            found[field.encode_name] = msgspec.to_builtins(field.default)
        elif field.default_factory is not msgspec.NODEFAULT:
            found[field.encode_name] = msgspec.to_builtins(field.default_factory())
    return found


def convert(value: Any, kind: type[Kind], field: str = "") -> Kind:
    """A struct from plain data.

    Raises:
        InvalidValue: with the path of the offending value below `field`.
    """
    try:
        return msgspec.convert(value, kind)
    except msgspec.ValidationError as error:
        raise invalid_value(error, field) from None


def invalid_value(error: msgspec.ValidationError, field: str = "") -> InvalidValue:
    """Return an InvalidValue for an error of msgspec: the field's path, then the problem."""
    text = str(error)
    match = PATH.search(text)
    path = match["path"] if match else ""
    where = ".".join(part for part in (field, path) if part)
    return InvalidValue(where, f"{PATH.sub('', text)}.")
