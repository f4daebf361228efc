"""Episodes of a campaign: a list without trajectories, one with all that is kept of it."""

from typing import Annotated

from fastapi import APIRouter, Query

from eigenfail.values import EpisodeResult, Outcome, Page
from eigenfail.values.records import EpisodeRow
from eigenfail.wire.http import PREFIX
from eigenfail_api.parameters import LARGEST, CampaignId, EpisodeIndex, Limit, Stored
from eigenfail_api.schemas import Json, documented

router = APIRouter(prefix=f"{PREFIX}/campaigns/{{campaign}}/episodes", tags=["episodes"])

After = Annotated[
    int | None,
    Query(ge=0, le=LARGEST, description="Only indices above this one: `next` of a page."),
]


@router.get("", **documented(Page[EpisodeRow]))
def list_episodes(
    store: Stored,
    campaign: CampaignId,
    limit: Limit = 100,
    after: After = None,
    outcome: Annotated[Outcome | None, Query(description="Only of this outcome.")] = None,
) -> Json:
    """Finished episodes, in index order."""
    store.campaigns.get(campaign)
    return Json(store.episodes.page(campaign, limit, after, outcome))


@router.get("/{index}", **documented(EpisodeResult))
def get_episode(store: Stored, campaign: CampaignId, index: EpisodeIndex) -> Json:
    """One result with its noise and, where it was kept, its scene."""
    return Json(store.episodes.get(campaign, index))
