"""Errors as RFC 9457 problems, and back: the client raises what the service raised."""

import re
from collections.abc import Iterator
from http import HTTPStatus

import msgspec

from eigenfail.errors import (
    Conflict,
    EigenfailError,
    Forbidden,
    InputError,
    NoisePruned,
    NotFound,
    ServiceError,
    Unauthorized,
    UnknownName,
)

NAMESPACE = "urn:eigenfail:"
UNTYPED = "about:blank"
SERVER_SIDE = 500

HUMP = re.compile(r"(?<=[a-z])(?=[A-Z])")


class Problem(msgspec.Struct, frozen=True, kw_only=True, omit_defaults=True):
    """Why a request was not done.

    Attributes:
        type: urn:eigenfail: and the error's name, or about:blank where the status says it all.
        detail: what was wrong and where.
        instance: the path that was asked for.
        field: path of the value that was refused.
        remedy: what to do next.
        name: the name that is not known.
        known: the names that are.
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


def problem_of(error: EigenfailError, instance: str = "") -> Problem:
    """The problem that tells a client of an error."""
    words = HUMP.split(type(error).__name__)
    unknown = error if isinstance(error, UnknownName) else None
    return Problem(
        type=NAMESPACE + slug(type(error)),
        title=" ".join(words).capitalize(),
        status=error.http_status,
        detail=error.problem,
        instance=instance,
        field=error.field if isinstance(error, InputError) else "",
        remedy=error.remedy,
        name=unknown.name if unknown else "",
        known=tuple(unknown.known) if unknown else (),
    )


def untyped_problem(status: int, detail: str, instance: str = "", remedy: str = "") -> Problem:
    """A problem that is no error of ours: no such address, method not allowed, too large …"""
    return Problem(
        type=UNTYPED,
        title=HTTPStatus(status).phrase,
        status=status,
        detail=detail,
        instance=instance,
        remedy=remedy,
    )


def error_of(problem: Problem) -> EigenfailError:
    """The error that a problem tells of."""
    kind = {NAMESPACE + slug(kind): kind for kind in tree(EigenfailError)}.get(problem.type)
    kind = kind or by_status(problem.status)
    if issubclass(kind, UnknownName):
        return kind(problem.field, problem.name, problem.known)
    if issubclass(kind, InputError):
        detail = problem.detail.removeprefix(f"{problem.field}: ")
        return kind(problem.field, detail, problem.remedy)
    return kind(problem.detail, problem.remedy)


def by_status(status: int) -> type[EigenfailError]:
    """The error to raise for a problem without a type that is known here."""
    exact: dict[int, type[EigenfailError]] = {
        401: Unauthorized,
        403: Forbidden,
        404: NotFound,
        409: Conflict,
        410: NoisePruned,
    }
    return exact.get(status, ServiceError if status >= SERVER_SIDE else InputError)


def slug(kind: type[EigenfailError]) -> str:
    """The name of an error in a problem's type: UnknownName is unknown-name."""
    return HUMP.sub("-", kind.__name__).lower()


def tree(kind: type[EigenfailError]) -> Iterator[type[EigenfailError]]:
    """An error and all below it."""
    yield kind
    for below in kind.__subclasses__():
        yield from tree(below)
