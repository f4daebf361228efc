"""Parameters and bodies of requests: their types, and refusals before a route runs."""

from collections import Counter
from collections.abc import Awaitable, Callable, Iterable, Iterator
from typing import Annotated, Any, TypeVar, get_origin
from urllib.parse import parse_qsl

import msgspec
from fastapi import Depends, Header, HTTPException, Path, Query, Request
from fastapi.dependencies.models import Dependant
from fastapi.responses import JSONResponse

from eigenfail.errors import InvalidValue, PreconditionFailed, UnknownName
from eigenfail.settings import LARGEST_INTEGER
from eigenfail.wire import http
from eigenfail.wire.http import IDEMPOTENCY_KEY
from eigenfail_api.access.authentication import get_caller_key, get_caller_name
from eigenfail_api.access.change_details import record_body
from eigenfail_api.middleware import is_named, make_tag
from eigenfail_services.store.store import Store

LARGEST = LARGEST_INTEGER
IDS = r"^[1-9]\d{0,18}(,[1-9]\d{0,18}){0,99}$"
MANY_IDS = r"^[1-9]\d{0,18}(,[1-9]\d{0,18})*$"
LONGEST_IDS = 20_000
"""Length of as many ids as a suite can have members. [characters]"""
FORMS = {
    IDS: "1 to 100 ids, such as 1 or 1,2,3",
    MANY_IDS: "ids such as 1 or 1,2,3",
}
"""Descriptions of patterns, for messages."""


async def store_of(request: Request) -> Store:
    """Return the application's store."""
    # This and similar functions are asynchronous, since FastAPI would run plain ones in a thread.
    store: Store = request.app.state.store
    return store


async def refuse_unknown_parameters(request: Request) -> None:
    """Refuse query parameters that the route does not have.

    Raises:
        UnknownName: a parameter is unknown; the known ones are listed.
    """
    known = [name for name, _ in _query_parameters(request.scope["route"].dependant)]
    for name in request.query_params:
        if name not in known:
            raise UnknownName("query", name, known)


async def refuse_repeated_parameters(request: Request) -> None:
    """Refuse a repeated query parameter if the route reads only one value.

    Raises:
        InvalidValue: a parameter is repeated.
    """
    times = Counter(name for name, _ in request.query_params.multi_items())
    for name, kind in _query_parameters(request.scope["route"].dependant):
        if times[name] > 1 and get_origin(kind) is not list:
            problem = f"is given {times[name]} times; only one value is allowed."
            raise InvalidValue(name, problem, "Send it once.")


async def refuse_other_media(request: Request) -> None:
    """Refuse media types of bodies and answers that the route does not support.

    Raises:
        HTTPException: 415 or 406; the supported types are listed.
    """
    route = request.scope["route"]
    # Pages are for browsers, which accept anything; only routes of the API declare media types.
    if not route.include_in_schema:
        return
    body = (route.openapi_extra or {}).get("requestBody", {})
    sent, read = request.headers.get("content-type"), {*body.get("content", {})}
    if sent and read and _strip(sent) not in read:
        raise HTTPException(415, f"The body is {_strip(sent)}; this route accepts {_join(read)}.")
    found = [each for status, each in route.responses.items() if str(status).startswith("2")]
    written = {_strip(kind) for each in found for kind in each.get("content", {})}
    accepted = request.headers.get("accept", "*/*")
    if written and not any(_accepts(accepted, kind) for kind in written):
        raise HTTPException(406, f"This route returns {_join(written)}, not {accepted}.")


def _strip(kind: str) -> str:
    return kind.partition(";")[0].strip().lower()


def _accepts(accepted: str, kind: str) -> bool:
    ranges = {_strip(one) for one in accepted.split(",")}
    return bool(ranges & {"*/*", "", kind, f"{kind.partition('/')[0]}/*"})


def _join(kinds: Iterable[str]) -> str:
    return " or ".join(sorted(kinds))


def _query_parameters(dependant: Dependant) -> Iterator[tuple[str, Any]]:
    """Yield names and types of the query parameters of a route and its dependencies."""
    yield from ((each.alias, each.field_info.annotation) for each in dependant.query_params)
    for below in dependant.dependencies:
        yield from _query_parameters(below)


Stored = Annotated[Store, Depends(store_of)]
MadeBy = Annotated[int | None, Depends(get_caller_key)]
CallerName = Annotated[str, Depends(get_caller_name)]
CampaignId = Annotated[int, Path(ge=1, le=LARGEST, description="Id of a campaign.")]
AnalysisId = Annotated[int, Path(ge=1, le=LARGEST, description="Id of an analysis.")]
ModeNumber = Annotated[int, Path(ge=1, le=LARGEST, description="Number of the mode, from 1.")]
EpisodeIndex = Annotated[int, Path(ge=0, le=LARGEST, description="Index within the campaign.")]
Limit = Annotated[int, Query(ge=1, le=1000, description="Maximum number of items on a page.")]
Project = Annotated[str | None, Query(description="Limit to this project.")]
WithTotal = Annotated[
    bool,
    Query(
        alias="total",
        description="Whether `total` is the number of items that match, on all pages together.",
    ),
]
Before = Annotated[
    int | None,
    Query(ge=1, le=LARGEST, description="Only ids below this one (`next` of a page)."),
]


class PageRequest(msgspec.Struct, frozen=True):
    """The requested page of a list.

    Attributes:
        limit: maximum number of items.
        cursor: `next` of the previous page; None for the first page.
        with_total: whether the page contains the total number of matching items.
    """

    limit: int
    cursor: int | None
    with_total: bool


IdempotencyKey = Annotated[
    str | None,
    Header(
        alias=IDEMPOTENCY_KEY,
        min_length=1,
        max_length=200,
        description="Requests with the same key are executed once and get the same response.",
    ),
]


def make_outdated_error() -> PreconditionFailed:
    """Return the error of a change whose `If-Match` does not name the present version."""
    return PreconditionFailed(
        "What is there is not what `If-Match` names: it was changed meanwhile, or has no ETag.",
        "Get it again, and send the ETag of that answer.",
    )


def read_precondition(
    values: Annotated[
        str | None,
        Header(
            alias="If-Match",
            description="ETag of the answer that the change is made for; 412 if it is outdated.",
        ),
    ] = None,
) -> Callable[[object], None]:
    """Return a check of the present value, to be called in the transaction that changes it.

    The check raises PreconditionFailed if `If-Match` does not name this value.
    """

    def check(value: object) -> None:
        if values is not None and not is_named([values], make_tag(http.encode(value))):
            raise make_outdated_error()

    return check


Precondition = Annotated[Callable[[object], None], Depends(read_precondition)]


Body = TypeVar("Body", bound=msgspec.Struct)
Plain = TypeVar("Plain", dict[str, Any], list[Any])


class Json(JSONResponse):
    """Response with a struct as JSON."""

    def render(self, content: Any) -> bytes:
        """Return the bytes of the body."""
        return http.encode(content)


def body_of(kind: type[Body]) -> Callable[[Request], Awaitable[Body]]:
    """Return a dependency that reads the body of a request.

    It raises ProtocolError, UnknownName or InvalidValue, as `read_body` does.
    """

    async def read(request: Request) -> Body:
        body = http.read_body(await read_within(request), kind)
        record_body(request.scope, body)
        return body

    return read


def plain_body(kind: type[Plain]) -> Callable[[Request], Awaitable[Plain]]:
    """Return a dependency that reads the body of a request as plain data; empty if there is none.

    It raises ProtocolError for a body that is not JSON, and InvalidValue for another kind of JSON.
    """

    async def read(request: Request) -> Plain:
        return http.read_plain(await read_within(request), kind)

    return read


async def read_within(request: Request) -> bytes:
    """Return the bytes of a request's body.

    Raises:
        HTTPException: 413, it is larger than the limit.
    """
    most = request.app.state.settings.max_body_bytes
    # The bytes are counted while they arrive: `Content-Length` may be missing or wrong.
    data = bytearray()
    async for part in request.stream():
        data += part
        if len(data) > most:
            raise HTTPException(413, f"The body is larger than {most} bytes.")
    return bytes(data)


async def read_form(request: Request, most_fields: int) -> dict[str, str]:
    """Return the texts of a form by the names of its elements; an empty one has an empty text.

    Raises:
        HTTPException: 400, the body is not a form, or has more fields; 413, it is larger than the
            limit.
    """
    body = await read_within(request)
    try:
        pairs = parse_qsl(body.decode(), keep_blank_values=True, max_num_fields=most_fields)
    except ValueError as error:
        raise HTTPException(400, f"The form is invalid: {error}.") from None
    return dict(pairs)
