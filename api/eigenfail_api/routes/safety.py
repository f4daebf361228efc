"""The safety measures of campaigns, and where they fail."""

from typing import Annotated

from fastapi import APIRouter, Query

from eigenfail.values import Region, Safety
from eigenfail.values.safety import LEVEL
from eigenfail.wire.http import PREFIX
from eigenfail_api.aside import Aside
from eigenfail_api.bodies import Json
from eigenfail_api.parameters import CampaignId, Stored
from eigenfail_api.routes.comparisons import Ids, numbers
from eigenfail_api.schemas import documented
from eigenfail_services.campaigns.region import region_aside
from eigenfail_services.campaigns.safety import safety_of

router = APIRouter(prefix=f"{PREFIX}/campaigns", tags=["campaigns"])

REGIONS = Aside("region")

Level = Annotated[float, Query(gt=0.0, lt=1.0, description="Of VaR and CVaR of severity.")]


@router.get("/{campaign}/safety", **documented(Safety))
def get_safety(store: Stored, campaign: CampaignId, level: Level = LEVEL) -> Json:
    """Collisions, near misses, MinTTC, DRAC and severity of a campaign's episodes so far."""
    return Json(safety_of(store, store.campaigns.get(campaign), level))


@router.get("/region", **documented(Region))
async def get_region(store: Stored, campaigns: Ids) -> Json:
    """Where among their scenario's parameters the episodes of some campaigns fail."""
    return Json(await REGIONS.do(region_aside, store, numbers(campaigns)))
