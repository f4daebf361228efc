"""The address of the comparison."""

from typing import Annotated

from fastapi import APIRouter, Query
from fastapi.responses import HTMLResponse

from eigenfail_api.dashboard.rendering import page
from eigenfail_api.dashboard.views.comparison import comparison_view
from eigenfail_api.parameters import Stored
from eigenfail_api.routes.comparisons import IDS, numbers
from eigenfail_services.campaigns.comparison import compare

router = APIRouter(include_in_schema=False, default_response_class=HTMLResponse)

Ids = Annotated[str | None, Query(pattern=IDS)]


@router.get("/comparison")
def show_comparison(store: Stored, a: Ids = None, b: Ids = None) -> HTMLResponse:
    """Two groups of campaigns side by side, once they were named."""
    found = compare(store, numbers(a), numbers(b)) if a and b else None
    return page("comparison.html", comparison_view(found, a or "", b or ""))
