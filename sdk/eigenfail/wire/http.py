"""Bodies of requests and answers between client and API, and errors as RFC 9457 problems.

Bodies are JSON through msgspec, with arrays as nested lists. Both sides read and write with the
functions here. The client raises the error that the service raised.
"""

import re
from collections.abc import Iterator, Mapping, Sequence
from contextlib import suppress
from http import HTTPStatus
from typing import Annotated, Any, TypeVar

import msgspec

from eigenfail import errors
from eigenfail.settings import Ordinal, convert, make_refusal, refuse_hidden
from eigenfail.values.analysis import LONGEST_MODE_NAME
from eigenfail.values.arrays import decode_array, encode_array_as_lists
from eigenfail.values.campaign_spec import CampaignSpec, Settings
from eigenfail.values.showing import Brief

NAMESPACE = "urn:eigenfail:"
UNTYPED = "about:blank"
SERVER_SIDE = 500

HUMP = re.compile(r"(?<=[a-z])(?=[A-Z])")


class Problem(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Why a request was refused or failed.

    Attributes:
        type: urn:eigenfail: and the error's name, or about:blank if the status is sufficient.
        detail: description of the problem and its place.
        instance: path of the request.
        field: path of the refused value.
        remedy: what to do next.
        name: the unknown name.
        known: the known names.
    """

    type: str
    title: str
    status: int
    detail: str
    instance: str = ""
    field: str = ""
    remedy: str = ""
    name: str = ""
    known: tuple[str, ...] = ()


def make_problem(error: errors.EigenfailError, instance: str = "") -> Problem:
    """Return the problem that describes an error."""
    words = HUMP.split(type(error).__name__)
    unknown = error if isinstance(error, errors.UnknownName) else None
    return Problem(
        type=NAMESPACE + slugify(type(error)),
        title=" ".join(words).capitalize(),
        status=error.http_status,
        detail=error.problem,
        instance=instance,
        field=error.field if isinstance(error, errors.InputError) else "",
        remedy=error.remedy,
        name=unknown.name if unknown else "",
        known=tuple(unknown.known) if unknown else (),
    )


def make_untyped_problem(status: int, detail: str, instance: str = "", remedy: str = "") -> Problem:
    """Return a problem for a status without an eigenfail error, such as 405 or 413."""
    return Problem(
        type=UNTYPED,
        title=HTTPStatus(status).phrase,
        status=status,
        detail=detail,
        instance=instance,
        remedy=remedy,
    )


def make_error(problem: Problem) -> errors.EigenfailError:
    """Return the error that a problem describes."""
    kinds = {NAMESPACE + slugify(kind): kind for kind in list_error_types(errors.EigenfailError)}
    # A service of a later release may raise an error that this client has no class for.
    kind = kinds.get(problem.type) or _get_type_for_status(problem.status)
    # `InputError` puts the field in front of the problem again.
    detail = problem.detail.removeprefix(f"{problem.field}: ")
    if issubclass(kind, errors.UnknownName):
        return kind(problem.field, problem.name, problem.known, detail)
    if issubclass(kind, errors.InputError):
        return kind(problem.field, detail, problem.remedy)
    return kind(problem.detail, problem.remedy)


def _get_type_for_status(status: int) -> type[errors.EigenfailError]:
    exact: dict[int, type[errors.EigenfailError]] = {
        401: errors.Unauthorized,
        403: errors.Forbidden,
        404: errors.NotFound,
        409: errors.Conflict,
        410: errors.NoisePruned,
        412: errors.PreconditionFailed,
    }
    return exact.get(status, errors.ServiceError if status >= SERVER_SIDE else errors.InputError)


def slugify(kind: type[errors.EigenfailError]) -> str:
    """Return the name of an error in a problem's type: unknown-name for UnknownName."""
    return HUMP.sub("-", kind.__name__).lower()


def list_error_types(kind: type[errors.EigenfailError]) -> Iterator[type[errors.EigenfailError]]:
    """Yield a type of error and all its subclasses."""
    yield kind
    for below in kind.__subclasses__():
        yield from list_error_types(below)


PREFIX = "/api/v1"
IDEMPOTENCY_KEY = "Idempotency-Key"
PROBLEM_JSON = "application/problem+json"
MAX_VARIATIONS = 100

NOT_JSON = (msgspec.DecodeError, UnicodeDecodeError, RecursionError)
"""Errors of bytes that are no JSON, no text, or nested too deeply."""

ESCAPE = b"\\u"
"""What JSON of plain ASCII needs to write any other character."""

Body = TypeVar("Body", bound=msgspec.Struct)
Kind = TypeVar("Kind")
Plain = TypeVar("Plain", dict[str, Any], list[Any])


class ModeName(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The new name of a failure mode."""

    name: Annotated[str, msgspec.Meta(min_length=1, max_length=LONGEST_MODE_NAME)]


class ProofRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Scenarios for the proof of an analysis by replay.

    Attributes:
        variations: scenario parameters that replace parameters of the failures' scenario; an empty
            object is the same scenario. None: the same scenario, and its neighbours on both sides.
    """

    variations: (
        Annotated[tuple[Settings, ...], msgspec.Meta(min_length=1, max_length=MAX_VARIATIONS)]
        | None
    ) = None


class ReplayRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Replay of an episode's noise, multiplied by `scale`."""

    scale: Annotated[float, msgspec.Meta(ge=0.1, le=2.0)] = 1.0


SHRINK_WITHIN = 2_000
"""Replays that are enough to shrink a failure of a hundred steps, as a rule."""


class ShrinkRequest(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Search for the least noise that still makes an episode fail.

    Attributes:
        episodes: budget of replays.
    """

    episodes: Ordinal = SHRINK_WITHIN


class Digest(msgspec.Struct, frozen=True):
    """SHA-256 over the digests of all results so far, in index order.

    Attributes:
        episodes: number of results that it covers.
        final: whether the campaign has ended, so that the digest cannot change any more.
    """

    campaign: int
    digest: str
    episodes: int
    final: bool


class PluginInfo(Brief, msgspec.Struct, frozen=True):
    """A plug-in that campaigns can name.

    Attributes:
        summary: description in one line.
        settings: JSON schema of its settings (of a scenario: its parameters).
        problem: why it cannot be loaded here; empty if it can.
    """

    name: str
    summary: str = ""
    settings: dict[str, Any] = {}
    problem: str = ""


class Health(msgspec.Struct, frozen=True):
    """The service is healthy."""

    status: str = "ok"


_encoder = msgspec.json.Encoder(enc_hook=encode_array_as_lists)


def encode(value: object) -> bytes:
    """Return the JSON of a value."""
    return _encoder.encode(value)


def decode(data: bytes, kind: type[Kind]) -> Kind:
    """Return the value in the JSON of an answer.

    Raises:
        ProtocolError: the answer is not a value of this kind.
    """
    try:
        return msgspec.json.decode(data, type=kind, dec_hook=decode_array)
    except (msgspec.DecodeError, RecursionError, ValueError) as error:
        raise errors.ProtocolError(
            f"The response has an unexpected format: {error}.",
            "Use one version of eigenfail on both sides.",
        ) from error


def read_body(data: bytes, kind: type[Body]) -> Body:
    """Return the body of a request; an empty body is an object without fields.

    Raises:
        ProtocolError: the body is not JSON.
        UnknownName: it has an unknown field.
        InvalidValue: a value has the wrong type, is out of bounds, is missing, or has a text with
            an invisible character.
    """
    try:
        body = msgspec.json.decode(data or b"{}", type=kind)
    except msgspec.ValidationError as error:
        given = msgspec.UNSET
        with suppress(*NOT_JSON):  # what follows the wrong value has not been read
            given = msgspec.json.decode(data or b"{}")
        raise make_refusal(error, kind, given) from None
    except NOT_JSON as error:
        raise errors.ProtocolError(
            f"The body is not JSON: {error}.", "Send a JSON object."
        ) from None
    # Only such bodies can hold invisible characters; all others are not read a second time.
    if not data.isascii() or ESCAPE in data:
        refuse_hidden(msgspec.json.decode(data))
    return body


def read_plain(data: bytes, kind: type[Plain]) -> Plain:
    """Return the body of a request as plain data; without bytes, an empty value of `kind`.

    Raises:
        ProtocolError: the body is not JSON.
        InvalidValue: it is JSON of another kind, or has a text with an invisible character.
    """
    try:
        given = msgspec.json.decode(data) if data else kind()
    except NOT_JSON as error:
        raise errors.ProtocolError(f"The body is not JSON: {error}.", "Send JSON.") from None
    if not data.isascii() or ESCAPE in data:
        refuse_hidden(given)
    return convert(given, kind)


def read_fields(given: Mapping[str, Any], kind: type[Body]) -> Body:
    """Return a body made of keyword arguments, whose values may be structs or plain data.

    Raises:
        UnknownName: a field is unknown.
        InvalidValue: a value has the wrong type, is out of bounds, or is missing.
    """
    return convert(make_plain(given), kind)


def make_plain(given: Mapping[str, Any], place: str = "") -> dict[str, Any]:
    """Return fields as plain data: structs as their fields, numbers and arrays as plain ones.

    Arrays of numpy, series of pandas, ranges and other sequences become lists.

    Args:
        given: values by the names of fields.
        place: path of the fields, for the error, such as `[2].`.

    Raises:
        InvalidValue: a value has another type.
    """
    return {name: _make_plain(f"{place}{name}", value) for name, value in given.items()}


def _make_plain(field: str, value: object) -> object:
    try:
        return msgspec.to_builtins(value, enc_hook=_make_builtin)
    except TypeError as error:
        remedy = "Give plain numbers, text, lists and dicts."
        raise errors.InvalidValue(field, f"{error}.", remedy) from None


def _make_builtin(value: object) -> Any:
    # A series of pandas is no sequence to Python, and has the same method as an array.
    if callable(convert_to_list := getattr(value, "tolist", None)):
        return convert_to_list()
    if isinstance(value, Sequence):
        return list(value)
    raise TypeError(f"an object of type {type(value).__name__} is not plain data")


MAX_CAMPAIGNS_AT_ONCE = 500
"""Largest number of campaigns that one request creates."""


class CampaignCheck(msgspec.Struct, frozen=True):
    """Result of checking a campaign before it is launched.

    Attributes:
        spec: full specification, including the defaults of plug-ins; None if there is a problem.
        problems: all reasons to refuse a launch.
        notes: remarks before the launch, such as how late a stop rule may take effect.
    """

    spec: CampaignSpec | None
    problems: tuple[Problem, ...] = ()
    notes: tuple[str, ...] = ()
