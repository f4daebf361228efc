"""An episode again: what its planner says of it, a replay as a campaign, its steps as a file."""

from typing import Annotated, Any

from fastapi import APIRouter, Depends, Response

from eigenfail.values import Campaign, Explanation
from eigenfail.wire.http import PREFIX, ReplayRequest
from eigenfail_api.aside import Aside
from eigenfail_api.bodies import Json, body_of
from eigenfail_api.parameters import CampaignId, EpisodeIndex, MadeBy, Stored
from eigenfail_api.schemas import documented, refusal
from eigenfail_services.campaigns.episode_replays import replay_episode
from eigenfail_services.campaigns.episode_steps import steps_csv
from eigenfail_services.campaigns.explanations import Explanations

router = APIRouter(prefix=f"{PREFIX}/campaigns/{{campaign}}/episodes", tags=["episodes"])

ASIDE = Aside("explain")
EXPLANATIONS = Explanations()

CSV = "text/csv; charset=utf-8"
CSV_CONTENT: dict[str, Any] = {CSV: {"schema": {"type": "string"}}}


@router.get("/{index}/explanation", **documented(Explanation))
async def get_explanation(store: Stored, campaign: CampaignId, index: EpisodeIndex) -> Json:
    """The episode run again from its noise, with its planner's account of each step."""
    return Json(await ASIDE.do(EXPLANATIONS.of, store, campaign, index))


@router.post("/{index}/replay", **documented(Campaign, 201, body=ReplayRequest))
def create_replay(
    store: Stored,
    campaign: CampaignId,
    index: EpisodeIndex,
    request: Annotated[ReplayRequest, Depends(body_of(ReplayRequest))],
    made_by: MadeBy,
) -> Json:
    """Queue a campaign that injects the episode's noise again, as it was or scaled."""
    made = replay_episode(store, campaign, index, request.scale, made_by)
    return Json(made, 201, {"Location": f"{PREFIX}/campaigns/{made.id}"})


@router.get(
    "/{index}/steps",
    response_class=Response,
    responses={200: {"content": CSV_CONTENT}, "default": refusal()},
)
def get_steps(store: Stored, campaign: CampaignId, index: EpisodeIndex) -> Response:
    """The steps of an episode as CSV: its noise and, where it was kept, its scene."""
    text = steps_csv(store.episodes.get(campaign, index))
    name = f'attachment; filename="episode-{campaign}-{index}.csv"'
    return Response(text, media_type=CSV, headers={"Content-Disposition": name})
