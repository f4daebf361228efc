"""What noise was taken from campaigns to make room."""

from fastapi import APIRouter

from eigenfail.values import Page
from eigenfail.values.retention import Pruning
from eigenfail.wire.http import PREFIX
from eigenfail_api.bodies import Json
from eigenfail_api.parameters import CampaignId, Stored
from eigenfail_api.schemas import documented

router = APIRouter(prefix=f"{PREFIX}/campaigns", tags=["campaigns"])


@router.get("/{campaign}/prunings", **documented(Page[Pruning]))
def list_prunings(store: Stored, campaign: CampaignId) -> Json:
    """By which rule noise was taken from a campaign, when, by whom and how much; oldest first."""
    store.campaigns.get(campaign)
    return Json(Page(store.retention.of(campaign)))
