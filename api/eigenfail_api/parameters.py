"""What routes take from a request: the store, ids, pages, keys."""

from collections.abc import Iterator
from typing import Annotated

from fastapi import Depends, Header, Path, Query, Request
from fastapi.dependencies.models import Dependant

from eigenfail.contracts import Store
from eigenfail.errors import UnknownName
from eigenfail.wire.http import IDEMPOTENCY_KEY

LARGEST = 2**63 - 1


async def store_of(request: Request) -> Store:
    """The store behind the API."""
    store: Store = request.app.state.store
    return store


async def refuse_unknown_parameters(request: Request) -> None:
    """Query parameters that the route does not have.

    Raises:
        UnknownName: there is one; the known ones are listed.
    """
    known = [*query_names(request.scope["route"].dependant)]
    for name in request.query_params:
        if name not in known:
            raise UnknownName("query", name, known)


def query_names(dependant: Dependant) -> Iterator[str]:
    """The query parameters of a route and of what it depends on."""
    yield from (parameter.alias for parameter in dependant.query_params)
    for below in dependant.dependencies:
        yield from query_names(below)


Stored = Annotated[Store, Depends(store_of)]
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
