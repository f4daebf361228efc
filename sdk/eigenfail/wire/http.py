"""What client and API say to each other beside the values themselves: bodies and problems.

JSON through msgspec, arrays as nested lists; both sides read and write with the functions here.
"""

import re
from collections.abc import Iterator, Mapping
from contextlib import suppress
from typing import Annotated, Any, TypeVar, get_args

import msgspec

from eigenfail.errors import InvalidValue, ProtocolError, UnknownName
from eigenfail.settings import invalid_value
from eigenfail.values.arrays import decode_array, encode_array_as_lists
from eigenfail.values.campaign import Settings

PREFIX = "/api/v1"
IDEMPOTENCY_KEY = "Idempotency-Key"
PROBLEM_JSON = "application/problem+json"
MAX_VARIATIONS = 100

NOT_JSON = (msgspec.DecodeError, UnicodeDecodeError, RecursionError)
"""What is raised where bytes are no JSON, no text, or nested too deeply."""

MISSING = re.compile(r"missing required field `(?P<name>[^`]+)`")

Body = TypeVar("Body", bound=msgspec.Struct)
StructType = type[msgspec.Struct]
Kind = TypeVar("Kind")
Plain = TypeVar("Plain", dict[str, Any], list[Any])


class ProofRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """In which scenarios an analysis is to be proven by replay.

    Attributes:
        variations: scenario parameters with plain values, each put over those of the scenario in
            which the failures happened; an empty one is the same scenario. None: the same, and its
            neighbours to both sides.
    """

    variations: (
        Annotated[tuple[Settings, ...], msgspec.Meta(min_length=1, max_length=MAX_VARIATIONS)]
        | None
    ) = None


class ReplayRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How the noise of an episode is injected again: multiplied by `scale`."""

    scale: Annotated[float, msgspec.Meta(ge=0.1, le=2.0)] = 1.0


class Digest(msgspec.Struct, frozen=True):
    """SHA-256 over the digests of all results in index order, as far as they are in.

    Attributes:
        episodes: how many results it covers.
        final: whether the campaign is done, so that it will not change any more.
    """

    campaign: int
    digest: str
    episodes: int
    final: bool


class PluginInfo(msgspec.Struct, frozen=True):
    """A plug-in that campaigns can name.

    Attributes:
        summary: what it is, in one line.
        settings: JSON schema of its settings (of a scenario: its parameters).
        problem: why it cannot be used here; empty if it can.
    """

    name: str
    summary: str = ""
    settings: dict[str, Any] = {}
    problem: str = ""


class Health(msgspec.Struct, frozen=True):
    """The service is as well as was asked."""

    status: str = "ok"


_encoder = msgspec.json.Encoder(enc_hook=encode_array_as_lists)


def encode(value: object) -> bytes:
    """The JSON of a value."""
    return _encoder.encode(value)


def decode(data: bytes, kind: type[Kind]) -> Kind:
    """The value that an answer holds.

    Raises:
        ProtocolError: the answer is something else.
    """
    try:
        return msgspec.json.decode(data, type=kind, dec_hook=decode_array)
    except (msgspec.DecodeError, RecursionError, ValueError) as error:
        raise ProtocolError(
            f"The answer is not what was asked for: {error}.",
            "Use one version of eigenfail on both sides.",
        ) from error


def read_body(data: bytes, kind: type[Body]) -> Body:
    """The body of a request; nothing at all stands for an object without fields.

    Raises:
        ProtocolError: it is not JSON.
        UnknownName: it has a field that is not known.
        InvalidValue: a value of the wrong type, outside its bounds, or missing.
    """
    try:
        return msgspec.json.decode(data or b"{}", type=kind)
    except msgspec.ValidationError as error:
        with suppress(*NOT_JSON):
            refuse_unknown_fields(msgspec.json.decode(data or b"{}"), kind)
        raise complaint(error) from None
    except NOT_JSON as error:
        raise ProtocolError(f"The body is not JSON: {error}.", "Send a JSON object.") from None


def read_plain(data: bytes, kind: type[Plain]) -> Plain:
    """The body of a request as plain data; nothing at all stands for an empty one.

    Raises:
        ProtocolError: it is not JSON.
        InvalidValue: it is JSON of another kind.
    """
    try:
        found: Plain = msgspec.convert(msgspec.json.decode(data) if data else kind(), kind)
    except msgspec.ValidationError as error:
        raise complaint(error) from None
    except NOT_JSON as error:
        raise ProtocolError(f"The body is not JSON: {error}.", "Send JSON.") from None
    return found


def read_fields(given: Mapping[str, Any], kind: type[Body]) -> Body:
    """A body from keyword arguments; values may be structs or plain data.

    Raises:
        UnknownName: a field that is not known.
        InvalidValue: a value of the wrong type, outside its bounds, or missing.
    """
    try:
        plain = msgspec.to_builtins(dict(given))
        refuse_unknown_fields(plain, kind)
        return msgspec.convert(plain, kind)
    except msgspec.ValidationError as error:
        raise complaint(error) from None
    except TypeError as error:
        raise InvalidValue("", f"{error}.", "Give plain numbers, text, lists and dicts.") from None


def refuse_unknown_fields(given: Any, kind: type[msgspec.Struct], field: str = "") -> None:
    """Names that a struct, or a struct inside it, does not have.

    Raises:
        UnknownName: the first of them, with the known ones.
    """
    if not isinstance(given, dict):
        return
    tag = kind.__struct_config__.tag_field
    known = kind.__struct_fields__ if tag is None else (tag, *kind.__struct_fields__)
    for name in given:
        if name not in known:
            raise UnknownName(field, name, known)
    for name, kinds in inner_structs(kind):
        path = f"{field}.{name}" if field else name
        for inner in chosen(given.get(name), kinds, path):
            refuse_unknown_fields(given.get(name), inner, path)


def inner_structs(kind: StructType) -> Iterator[tuple[str, tuple[StructType, ...]]]:
    """The fields of a struct that are structs themselves, with the kinds that may stand there."""
    for field in msgspec.structs.fields(kind):
        kinds = get_args(field.type) or (field.type,)
        if all(isinstance(each, type) and issubclass(each, msgspec.Struct) for each in kinds):
            yield field.name, kinds


def chosen(given: Any, kinds: tuple[StructType, ...], field: str) -> tuple[StructType, ...]:
    """Those of the kinds that a value can be: the one whose tag it has, where kinds have tags.

    Raises:
        UnknownName: it has the tag of something else.
    """
    tag = kinds[0].__struct_config__.tag_field
    if tag is None or not isinstance(given, dict):
        return kinds
    known = {str(kind.__struct_config__.tag): kind for kind in kinds}
    wanted = given.get(tag)
    if isinstance(wanted, str) and wanted not in known:
        raise UnknownName(f"{field}.{tag}", wanted, known)
    return tuple(kind for name, kind in known.items() if name == wanted)


def complaint(error: msgspec.ValidationError) -> InvalidValue:
    """msgspec's complaint with the path of the field, also where that field is missing."""
    plain = invalid_value(error)
    missing = MISSING.search(str(error))
    if missing is None:
        return plain
    path = f"{plain.field}.{missing['name']}" if plain.field else missing["name"]
    return InvalidValue(path, "is required.")
