"""The route of the REST API, the page, and what else the plug-in adds to the service."""

from typing import Annotated

from anyio.to_thread import run_sync
from fastapi import APIRouter, Query
from fastapi.responses import HTMLResponse

from eigenfail.values.campaign import Campaign
from eigenfail.wire.http import PREFIX
from eigenfail_api import parameters
from eigenfail_api.concurrency import SerialExecutor
from eigenfail_api.dashboard.rendering import CampaignFile, page
from eigenfail_api.extensions import Extension
from eigenfail_api.openapi import document_route
from eigenfail_api.routes.analyses import parse_ids
from eigenfail_failing_region.campaigns import find_region_in_process
from eigenfail_failing_region.presentation import describe_region
from eigenfail_failing_region.values import Region
from eigenfail_services.campaigns.validation import list_drawn

router = APIRouter(prefix=PREFIX, tags=["campaigns"])
pages = APIRouter(include_in_schema=False, default_response_class=HTMLResponse)

PAGE = "eigenfail_failing_region/region.html"

# One at a time: a region is computed in a process that occupies a core for seconds.
REGIONS = SerialExecutor("region")

Ids = Annotated[
    str,
    Query(
        pattern=parameters.IDS,
        description="Ids of campaigns on one scenario, comma-separated.",
        examples=["1"],
    ),
]


@router.get("/region", **document_route(Region))
async def get_region(store: parameters.Stored, campaigns: Ids) -> parameters.Json:
    """Get the region of scenario parameters in which the episodes of campaigns fail."""
    return parameters.Json(await REGIONS.do(find_region_in_process, store, parse_ids(campaigns)))


@pages.get("/campaigns/{campaign}/region")
def show_region(store: parameters.Stored, campaign: parameters.CampaignId) -> HTMLResponse:
    """Show the page on which the failing region of a campaign appears."""
    # The region takes seconds to find: the page stands first, and then asks for the boxes.
    return page(PAGE, store.campaigns.get(campaign), found=())


@pages.get("/campaigns/{campaign}/region/boxes")
async def show_boxes(store: parameters.Stored, campaign: parameters.CampaignId) -> HTMLResponse:
    """Show the failing region of a campaign, which its page loads later."""
    found = await REGIONS.do(find_region_in_process, store, (campaign,))
    seen = await run_sync(store.campaigns.get, campaign)
    return page(PAGE, seen, found=describe_region(found))


def varies(campaign: Campaign) -> bool:
    """Return whether a campaign draws a parameter of its scenario for each episode."""
    return bool(list_drawn(campaign.spec))


extension = Extension(
    routers=(router, pages),
    templates="eigenfail_failing_region",
    campaign_files=(
        CampaignFile(
            "Failing region", "page", "/campaigns/{campaign}/region", is_page=True, suits=varies
        ),
    ),
)
