"""The address of the comparison."""

from typing import Annotated

from fastapi import APIRouter, Query
from fastapi.responses import HTMLResponse

from eigenfail.contracts import Store
from eigenfail.values import CampaignCost, Side
from eigenfail_api.dashboard.rendering import page
from eigenfail_api.dashboard.views.comparison import Bills, comparison_view
from eigenfail_api.parameters import Stored
from eigenfail_api.routes.comparisons import IDS, numbers
from eigenfail_services.campaigns.comparison import compare
from eigenfail_services.campaigns.spending import spending_of

router = APIRouter(include_in_schema=False, default_response_class=HTMLResponse)

Ids = Annotated[str | None, Query(pattern=IDS)]


@router.get("/comparison")
def show_comparison(store: Stored, a: Ids = None, b: Ids = None) -> HTMLResponse:
    """Two groups of campaigns side by side, once they were named."""
    found = compare(store, numbers(a), numbers(b)) if a and b else None
    bills = Bills(costs(store, found.a), costs(store, found.b)) if found else None
    return page("comparison.html", comparison_view(found, bills, a or "", b or ""))


def costs(store: Store, side: Side) -> tuple[CampaignCost, ...]:
    """What each campaign of a side cost."""
    return tuple(spending_of(store, store.campaigns.get(each)) for each in side.campaigns)
