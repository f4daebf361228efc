"""What campaigns cost, and what that bought."""

from fastapi import APIRouter

from eigenfail.values import CampaignCost
from eigenfail.wire.http import PREFIX
from eigenfail_api.parameters import CampaignId, Stored
from eigenfail_api.schemas import Json, documented
from eigenfail_services.campaigns.spending import spending_of

router = APIRouter(prefix=f"{PREFIX}/campaigns", tags=["campaigns"])


@router.get("/{campaign}/cost", **documented(CampaignCost))
def get_cost(store: Stored, campaign: CampaignId) -> Json:
    """What failures and modes of a campaign cost, by when, and what the time went into."""
    return Json(spending_of(store, store.campaigns.get(campaign)))
