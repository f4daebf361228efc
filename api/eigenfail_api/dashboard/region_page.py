"""The page of a failing region."""

from anyio.to_thread import run_sync
from fastapi import APIRouter
from fastapi.responses import HTMLResponse

from eigenfail.presentation.campaigns import describe_region
from eigenfail_api.dashboard.rendering import page
from eigenfail_api.parameters import CampaignId, Stored
from eigenfail_api.routes.analyses import REGIONS
from eigenfail_services.comparison.region import find_region_in_process

router = APIRouter(include_in_schema=False, default_response_class=HTMLResponse)


@router.get("/campaigns/{campaign}/region")
def show_region(store: Stored, campaign: CampaignId) -> HTMLResponse:
    """Show the page on which the failing region of a campaign appears."""
    # The region takes seconds to find: the page stands first, and then asks for the boxes.
    return page("region.html", store.campaigns.get(campaign), found=())


@router.get("/campaigns/{campaign}/region/boxes")
async def show_boxes(store: Stored, campaign: CampaignId) -> HTMLResponse:
    """Show the failing region of a campaign, which its page loads later."""
    found = await REGIONS.do(find_region_in_process, store, (campaign,))
    seen = await run_sync(store.campaigns.get, campaign)
    return page("region.html", seen, found=describe_region(found))
