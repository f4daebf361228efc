"""Settings of plug-ins: typed and bounded; errors give the path of a wrong setting."""

import re
from collections.abc import Iterator, Mapping, Sequence
from math import isfinite
from typing import Annotated, Any, TypeVar

import msgspec
import msgspec.inspect

from eigenfail.errors import (
    EigenfailError,
    InputError,
    InvalidValue,
    UnknownName,
    describe_error,
    find_hidden,
)

Kind = TypeVar("Kind", bound=msgspec.Struct)
Converted = TypeVar("Converted")

LARGEST_INTEGER = 2**63 - 1
"""Largest integer that the columns of databases hold."""

Ordinal = Annotated[int, msgspec.Meta(ge=1, le=LARGEST_INTEGER)]
Count = Annotated[int, msgspec.Meta(ge=0, le=LARGEST_INTEGER)]
"""Integers of requests: every one has bounds, so that none is too large for its column."""


def read_settings(kind: type[Kind], given: Mapping[str, Any], field: str) -> Kind:
    """Return the settings of a plug-in from a user's values, with defaults for all others.

    Args:
        kind: a frozen struct whose annotations carry the bounds.
        given: names and values as the user wrote them.
        field: field that the settings were given in, for the error.

    Raises:
        UnknownName: the plug-in does not have a setting of that name.
        InvalidValue: a value has the wrong type, is outside its bounds, or makes the plug-in raise.
    """
    known = kind.__struct_fields__
    # msgspec itself ignores unknown names, unless the struct of the plug-in forbids them.
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
    """Return the defaults of a struct's fields, as plain data, without required fields."""
    found: dict[str, Any] = {}
    for field in msgspec.structs.fields(kind):
        if field.default is not msgspec.NODEFAULT:
            found[field.encode_name] = msgspec.to_builtins(field.default)
        elif field.default_factory is not msgspec.NODEFAULT:
            found[field.encode_name] = msgspec.to_builtins(field.default_factory())
    return found


MAX_DEPTH = 20
"""Levels of lists and mappings within a value of a user."""


def list_values(value: Any) -> Iterator[tuple[str, Any]]:
    """Yield every plain value inside a value, with its path.

    Raises:
        InvalidValue: it is nested deeper than encoders allow.
    """
    # Without recursion: what a user sends may be nested more deeply than Python's stack is.
    waiting: list[tuple[tuple[str, ...], Any]] = [((), value)]
    while waiting:
        path, value = waiting.pop()
        if len(path) > MAX_DEPTH:
            raise InvalidValue(path[0], f"is nested more than {MAX_DEPTH} levels deep.")
        parts = list(_list_children(value))
        waiting.extend(((*path, name), part) for name, part in parts)
        if not parts:
            yield ".".join(path), value


def _list_children(value: Any) -> Iterator[tuple[str, Any]]:
    # The names in a mapping come from users, too, and are looked at like values.
    if isinstance(value, msgspec.Struct):
        yield from msgspec.structs.asdict(value).items()
    if isinstance(value, dict):
        yield from ((str(name), part) for name, part in value.items())
        yield from (("(name)", str(name)) for name in value)
    if isinstance(value, (list, tuple)):
        yield from ((str(place), part) for place, part in enumerate(value))


def refuse_hidden(value: Any) -> None:
    """Refuse invisible format characters in the texts and names of plain data.

    Raises:
        InvalidValue: a text has one; it could change how the text is read without being seen.
    """
    for path, part in list_values(value):
        if isinstance(part, str) and (found := find_hidden(part)):
            raise InvalidValue(path, f"contains the invisible character {found}.", "Take it out.")


def convert(value: Any, kind: type[Converted], field: str = "") -> Converted:
    """Return plain data as a value of a type, such as a struct.

    Raises:
        UnknownName: a struct does not have a field of that name; with the path of the struct.
        InvalidValue: a value is invalid; with its path below `field`.
    """
    try:
        return msgspec.convert(value, kind)
    except msgspec.ValidationError as error:
        raise make_refusal(error, kind, value, field) from None


def make_refusal(
    error: msgspec.ValidationError, kind: type, given: Any, field: str = ""
) -> InputError:
    """Return an error of msgspec in plain words, with the path of the wrong value.

    Args:
        error: error that msgspec raised for a value of `kind`.
        kind: the wanted type; its annotations carry the bounds.
        given: the whole value, as plain data.
        field: field of the whole value.

    Returns:
        UnknownName if a field or a kind is unknown and the known names can be listed, otherwise
        InvalidValue.
    """
    # msgspec says all of it in one text alone, which is taken apart here: its errors have no
    # attributes. tests/sdk/test_settings.py fails if a release of msgspec words them otherwise.
    text = str(error)
    match = _PATH.search(text)
    path, problem = match["path"] if match else "", _PATH.sub("", text)
    if missing := _MISSING.search(problem):
        path, problem = ".".join(filter(None, (path, missing["name"]))), "is required"
    elif named := _UNKNOWN.match(problem):
        if known := _list_known(kind, given, _STEP.findall(path), named):
            return UnknownName(".".join(filter(None, (field, path))), named["name"], known)
    elif wrong := _ENUM.match(problem):
        known = _list_choices(_list_types(kind, _STEP.findall(path)))
        problem = f"'{wrong['name']}' is none of {', '.join(known)}" if known else problem
    elif expected := _EXPECTED.match(problem):
        steps = _STEP.findall(path)
        types = _list_types(kind, steps)
        problem = _describe_refusal(_find_value(given, steps), types, expected)
    return InvalidValue(".".join(filter(None, (field, path))), f"{problem}.")


_PATH = re.compile(r" - at `\$\.?(?P<path>[^`]*)`")
_MISSING = re.compile(r"missing required field `(?P<name>[^`]+)`")
_EXPECTED = re.compile(r"Expected `(?P<kinds>[^`]+)`(?P<bound>[^,]*)")
_UNKNOWN = re.compile(r"(?s)(?:Object contains unknown field `|Invalid value ')(?P<name>.*)[`']")
_ENUM = re.compile(r"Invalid enum value '(?P<name>[^']*)'")
_STEP = re.compile(r"[^.\[\]]+|\.\.\.")
_NAMES = {
    "int": "an integer",
    "float": "a number",
    "str": "text",
    "array": "a list",
    "object": "an object",
    "bool": "true or false",
}
_BOUNDS = {
    " of length >= ": " of a length of at least ",
    " of length <= ": " of a length of at most ",
    " >= ": " of at least ",
    " <= ": " of at most ",
    " > ": " above ",
    " < ": " below ",
}
_LONGEST_VALUE = 60
"""Longer values are not repeated in an error. [characters]"""


def _describe_refusal(value: Any, types: Sequence[Any], expected: re.Match[str]) -> str:
    """Return the given value and the allowed ones in words: 588 is not a number from 52 to 70."""
    kinds = (kind.strip() for kind in expected["kinds"].split("|"))
    *others, last = (_NAMES.get(kind, kind) for kind in kinds if kind != "null")
    words = f"{', '.join(others)} or {last}" if others else last
    bound = expected["bound"]
    for sign, phrase in _BOUNDS.items():
        bound = bound.replace(sign, phrase)
    # msgspec names the bound that was broken, and a user wants to know both.
    numbers = (msgspec.inspect.IntType, msgspec.inspect.FloatType)
    wanted = next((each for each in types if isinstance(each, numbers)), None)
    least, most = getattr(wanted, "ge", None), getattr(wanted, "le", None)
    if bound and least is not None and most is not None:
        bound = f" from {least:.12g} to {most:.12g}"
    if isinstance(value, float) and not isfinite(value):
        return f"{value} is not {words}{bound}"
    text = "" if value is msgspec.UNSET else msgspec.json.encode(value, enc_hook=repr).decode()
    if not text or len(text) > _LONGEST_VALUE:
        return f"{words}{bound} is expected"
    return f"{text} is not {words}{bound}"


def _find_value(given: Any, path: Sequence[str]) -> Any:
    """Return the value at a path in plain data; UNSET if msgspec does not identify it."""
    for step in path:
        if isinstance(given, Mapping) and step in given:
            given = given[step]
        elif isinstance(given, list | tuple) and step.isdecimal() and int(step) < len(given):
            given = given[int(step)]
        else:
            return msgspec.UNSET
    return given


def _list_choices(types: Sequence[Any]) -> list[str]:
    """Return the texts that types allow; empty if msgspec does not list them."""
    enums = [each.cls for each in types if isinstance(each, msgspec.inspect.EnumType)]
    literals = [each.values for each in types if isinstance(each, msgspec.inspect.LiteralType)]
    members = [member.value for enum in enums for member in enum]
    return [str(each) for each in (*members, *(value for values in literals for value in values))]


def _list_known(kind: type, given: Any, path: Sequence[str], named: re.Match[str]) -> Sequence[str]:
    """Return the valid names in place of an unknown one: fields, or tags of a union's structs.

    Empty if msgspec does not describe the types at that path.
    """
    is_tag = not named[0].startswith("Object")
    place = path[:-1] if is_tag else path
    types = _list_types(kind, place)
    structs = [each for each in types if isinstance(each, msgspec.inspect.StructType)]
    if is_tag:
        return [str(each.tag) for each in structs if each.tag_field == path[-1]] if path else []
    value = _find_value(given, place)
    tags = value if isinstance(value, Mapping) else {}
    fitting = [
        each for each in structs if each.tag_field is None or tags.get(each.tag_field) == each.tag
    ]
    own_tags = {each.tag_field for each in fitting if each.tag_field is not None}
    return sorted(own_tags | {field.encode_name for each in fitting for field in each.fields})


def _list_types(kind: type, path: Sequence[str]) -> list[Any]:
    """Return the possible msgspec types at a path of fields and positions."""
    here = _flatten([msgspec.inspect.type_info(kind)])
    for step in path:
        fields = [field for each in here for field in getattr(each, "fields", ())]
        items = [each.item_type for each in here if hasattr(each, "item_type")]
        named = [field.type for field in fields if field.encode_name == step]
        here = _flatten([*items, *named])
    return here


def _flatten(types: Sequence[Any]) -> list[Any]:
    """Return types without metadata, with each union replaced by its members."""
    found: list[Any] = []
    for each in types:
        # Metadata holds schemas for OpenAPI; the bounds are those of the type within.
        plain: Any = each.type if isinstance(each, msgspec.inspect.Metadata) else each
        is_union = isinstance(plain, msgspec.inspect.UnionType)
        found += _flatten(plain.types) if is_union else [plain]
    return found
