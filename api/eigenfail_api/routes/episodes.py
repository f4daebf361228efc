"""Episodes of a campaign: a list without trajectories, one with all that is kept of it."""

from typing import Annotated, NamedTuple

from fastapi import APIRouter, Depends, Query

from eigenfail.values import Outcome, Page
from eigenfail.values.records import EpisodeDetail, EpisodeOrder, EpisodeRow, detailed
from eigenfail.wire.http import PREFIX
from eigenfail_api.parameters import LARGEST, CampaignId, EpisodeIndex, Limit, Stored
from eigenfail_api.schemas import Json, documented

router = APIRouter(prefix=f"{PREFIX}/campaigns/{{campaign}}/episodes", tags=["episodes"])

After = Annotated[
    int | None,
    Query(ge=0, le=LARGEST, description="Only those behind this index: `next` of a page."),
]
OnlyOutcome = Annotated[Outcome | None, Query(description="Only of this outcome.")]
Sort = Annotated[
    EpisodeOrder, Query(description="`severity`: worst collision first, no collision last.")
]


class Selection(NamedTuple):
    """Which episodes are wanted, and in which order."""

    outcome: Outcome | None
    order: EpisodeOrder


async def selection(outcome: OnlyOutcome = None, sort: Sort = EpisodeOrder.INDEX) -> Selection:
    """What was asked for."""
    return Selection(outcome, sort)


@router.get("", **documented(Page[EpisodeRow]))
def list_episodes(
    store: Stored,
    campaign: CampaignId,
    wanted: Annotated[Selection, Depends(selection)],
    limit: Limit = 100,
    after: After = None,
) -> Json:
    """Finished episodes, in index order or with the worst collisions first."""
    store.campaigns.get(campaign)
    return Json(store.episodes.page(campaign, limit, after, wanted.outcome, wanted.order))


@router.get("/{index}", **documented(EpisodeDetail))
def get_episode(store: Stored, campaign: CampaignId, index: EpisodeIndex) -> Json:
    """One result with its class, its noise and, where it was kept, its scene."""
    return Json(detailed(store.episodes.get(campaign, index)))
