"""What campaigns cost, and what that bought."""

from fastapi import APIRouter

from eigenfail.values import CampaignCost, Page
from eigenfail.values.pool import PeerCosts
from eigenfail.wire.http import PREFIX
from eigenfail_api.bodies import Json
from eigenfail_api.parameters import CampaignId, Stored
from eigenfail_api.schemas import documented
from eigenfail_services.campaigns.peers import peer_costs
from eigenfail_services.campaigns.spending import spending_of

router = APIRouter(prefix=PREFIX, tags=["campaigns"])


@router.get("/costs", **documented(Page[PeerCosts]))
def list_costs(store: Stored) -> Json:
    """What a failure costs by method, over all campaigns of one planner and scenario."""
    return Json(Page(peer_costs(store.figures.pools())))


@router.get("/campaigns/{campaign}/cost", **documented(CampaignCost))
def get_cost(store: Stored, campaign: CampaignId) -> Json:
    """What failures and modes of a campaign cost, by when, and what the time went into."""
    return Json(spending_of(store, store.campaigns.get(campaign)))
