"""The address of what a page shows, as programs ask for it."""

from typing import Annotated

from fastapi import APIRouter, Query, Request
from fastapi.responses import HTMLResponse

from eigenfail.errors import NotFound
from eigenfail_api.dashboard.rendering import page
from eigenfail_api.dashboard.views.copying import Asked, copies, service_of

router = APIRouter(include_in_schema=False, default_response_class=HTMLResponse)

ApiPath = Annotated[str, Query(max_length=1_000, description="Below /api/v1, as it is asked for.")]


@router.get("/copies")
def show_copies(request: Request, path: ApiPath) -> HTMLResponse:
    """A request for what is at a path, three times: a piece of the page that shows the same.

    Raises:
        NotFound: no page shows such a thing.
    """
    try:
        found = copies(service_of(request), Asked(method="GET", path=path))
    except KeyError as error:
        raise NotFound(f"Nothing is known of a request for '{path}'.") from error
    return page("copies.html", found)
