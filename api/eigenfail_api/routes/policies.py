"""What a campaign has learned, for whoever wants to look at it or to run it elsewhere."""

from fastapi import APIRouter

from eigenfail.values.policy import Policy
from eigenfail.wire.http import PREFIX
from eigenfail_api.bodies import Json
from eigenfail_api.parameters import CampaignId, Stored
from eigenfail_api.schemas import documented
from eigenfail_services.campaigns.policies import newest_policy

router = APIRouter(prefix=f"{PREFIX}/campaigns", tags=["campaigns"])


@router.get("/{campaign}/policy", **documented(Policy))
def get_policy(store: Stored, campaign: CampaignId) -> Json:
    """The newest version of the policy that a campaign trains: raw float32 weights, row by row."""
    return Json(newest_policy(store, store.campaigns.get(campaign)))
