"""What routes take from a request: the store, ids, pages, keys; what they refuse beforehand."""

from collections import Counter
from collections.abc import Iterable, Iterator
from typing import Annotated, Any, get_origin

from fastapi import Depends, Header, HTTPException, Path, Query, Request
from fastapi.dependencies.models import Dependant
from fastapi.routing import APIRoute

from eigenfail.contracts import Store
from eigenfail.errors import InvalidValue, UnknownName
from eigenfail.wire.http import IDEMPOTENCY_KEY
from eigenfail_api.access.callers import key_of_caller

LARGEST = 2**63 - 1
IDS = r"^[1-9]\d{0,18}(,[1-9]\d{0,18}){0,99}$"
EXPORT = "^[0-9a-f]{32}$"
FORMS = {IDS: "ids such as 1 or 1,2,3", EXPORT: "the id of an export, 32 hexadecimal digits"}
"""What a text of a pattern is, in words."""


async def store_of(request: Request) -> Store:
    """The store behind the API."""
    store: Store = request.app.state.store
    return store


async def refuse_unknown_parameters(request: Request) -> None:
    """Query parameters that the route does not have.

    Raises:
        UnknownName: there is one; the known ones are listed.
    """
    known = [name for name, _ in query_parameters(request.scope["route"].dependant)]
    for name in request.query_params:
        if name not in known:
            raise UnknownName("query", name, known)


async def refuse_repeated_parameters(request: Request) -> None:
    """Query parameters that come more than once where the route reads one value.

    Raises:
        InvalidValue: there is one; which of its values was meant, nobody knows.
    """
    times = Counter(name for name, _ in request.query_params.multi_items())
    for name, kind in query_parameters(request.scope["route"].dependant):
        if times[name] > 1 and get_origin(kind) is not list:
            problem = f"is given {times[name]} times, but it has one value."
            raise InvalidValue(name, problem, "Leave out all but one of them.")


async def refuse_other_media(request: Request) -> None:
    """A body that the route does not read, or an answer in a form that it does not write.

    Raises:
        HTTPException: 415 or 406; the forms that there are are listed.
    """
    route = request.scope["route"]
    if not route.include_in_schema:
        return
    sent, read = request.headers.get("content-type"), media_read(route)
    if sent and read and plain(sent) not in read:
        raise HTTPException(415, f"The body is {plain(sent)}; this address reads {listed(read)}.")
    accepted, written = request.headers.get("accept", "*/*"), media_written(route)
    if written and not any(accepts(accepted, kind) for kind in written):
        raise HTTPException(406, f"{accepted} is not to be had here, but {listed(written)}.")


def media_read(route: APIRoute) -> set[str]:
    """The kinds of bodies that a route reads, as its documentation has them."""
    return {*(route.openapi_extra or {}).get("requestBody", {}).get("content", {})}


def media_written(route: APIRoute) -> set[str]:
    """The kinds of answers that a route gives where it does not refuse."""
    successes = (told for status, told in route.responses.items() if str(status).startswith("2"))
    return {plain(kind) for told in successes for kind in told.get("content", {})}


def plain(kind: str) -> str:
    """A kind of content without its parameters."""
    return kind.partition(";")[0].strip().lower()


def accepts(accepted: str, kind: str) -> bool:
    """Whether an Accept header takes a kind of content."""
    ranges = {plain(one) for one in accepted.split(",")}
    return bool(ranges & {"*/*", "", kind, f"{kind.partition('/')[0]}/*"})


def listed(kinds: Iterable[str]) -> str:
    """Kinds of content in words."""
    return " or ".join(sorted(kinds))


def query_parameters(dependant: Dependant) -> Iterator[tuple[str, Any]]:
    """The query parameters of a route and of what it depends on, with their types."""
    yield from ((each.alias, each.field_info.annotation) for each in dependant.query_params)
    for below in dependant.dependencies:
        yield from query_parameters(below)


Stored = Annotated[Store, Depends(store_of)]
MadeBy = Annotated[int | None, Depends(key_of_caller)]
CampaignId = Annotated[int, Path(ge=1, le=LARGEST, description="Id of a campaign.")]
AnalysisId = Annotated[int, Path(ge=1, le=LARGEST, description="Id of an analysis.")]
EpisodeIndex = Annotated[int, Path(ge=0, le=LARGEST, description="Number within its campaign.")]
Limit = Annotated[int, Query(ge=1, le=1000, description="Most items on the page.")]
Before = Annotated[
    int | None, Query(ge=1, le=LARGEST, description="Only ids below this one: `next` of a page.")
]
IdempotencyKey = Annotated[
    str | None,
    Header(
        alias=IDEMPOTENCY_KEY,
        min_length=1,
        max_length=200,
        description="What comes twice under one key is done once and answered the same.",
    ),
]
