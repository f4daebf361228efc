"""Campaigns: create, list, look at, steer, sum up."""

from typing import Annotated

from fastapi import APIRouter, Depends, Query

from eigenfail.values import (
    Campaign,
    CampaignSpec,
    CampaignState,
    Course,
    MinimalFailure,
    Page,
    Summary,
)
from eigenfail.wire.http import PREFIX, Digest
from eigenfail_api import steering
from eigenfail_api.parameters import (
    LARGEST,
    Before,
    CampaignId,
    IdempotencyKey,
    Limit,
    Stored,
)
from eigenfail_api.schemas import Json, body_of, documented
from eigenfail_services.campaigns.checks import check_spec
from eigenfail_services.campaigns.course import course_of
from eigenfail_services.campaigns.materials import check_references
from eigenfail_services.campaigns.minimal_failures import minimal_failure
from eigenfail_services.campaigns.summary import summarise

router = APIRouter(prefix=f"{PREFIX}/campaigns", tags=["campaigns"])

Per = Annotated[
    int | None,
    Query(ge=1, le=LARGEST, description="Episodes of a block; by the budget if not given."),
]
WITH_LOCATION = {"Location": {"schema": {"type": "string"}, "description": "Its address."}}


def created(campaign: Campaign) -> Json:
    """The answer that a campaign has been created."""
    return Json(campaign, 201, {"Location": f"{PREFIX}/campaigns/{campaign.id}"})


@router.post("", **documented(Campaign, 201, body=CampaignSpec))
def create_campaign(
    store: Stored,
    spec: Annotated[CampaignSpec, Depends(body_of(CampaignSpec))],
    idempotency_key: IdempotencyKey = None,
) -> Json:
    """Queue a new campaign."""
    check_references(check_spec(spec), store)
    return created(store.campaigns.create(spec, idempotency_key))


@router.get("", **documented(Page[Campaign]))
def list_campaigns(
    store: Stored,
    limit: Limit = 50,
    before: Before = None,
    state: Annotated[CampaignState | None, Query(description="Only in this state.")] = None,
) -> Json:
    """Campaigns, newest first."""
    return Json(store.campaigns.page(limit, before, state))


@router.get("/summaries", **documented(Page[Summary]))
def list_summaries(store: Stored, limit: Limit = 50, before: Before = None) -> Json:
    """Failures, rate, likelihood and cost of campaigns, newest first."""
    page = store.campaigns.page(limit, before)
    summaries = tuple(summarise(seen, store.episodes.totals(seen.id)) for seen in page.items)
    return Json(Page(summaries, page.next))


@router.get("/{campaign}", **documented(Campaign))
def get_campaign(store: Stored, campaign: CampaignId) -> Json:
    """A campaign as it stands."""
    return Json(store.campaigns.get(campaign))


@router.post("/{campaign}/pause", **documented(Campaign))
def pause_campaign(store: Stored, campaign: CampaignId) -> Json:
    """Let a campaign rest once the rounds at work are in."""
    return Json(steering.steer(store, campaign, steering.PAUSE))


@router.post("/{campaign}/resume", **documented(Campaign))
def resume_campaign(store: Stored, campaign: CampaignId) -> Json:
    """Let a paused campaign go on."""
    return Json(steering.steer(store, campaign, steering.RESUME))


@router.post("/{campaign}/cancel", **documented(Campaign))
def cancel_campaign(store: Stored, campaign: CampaignId) -> Json:
    """End a campaign; finished episodes are kept."""
    return Json(steering.steer(store, campaign, steering.CANCEL))


@router.get("/{campaign}/summary", **documented(Summary))
def get_summary(store: Stored, campaign: CampaignId) -> Json:
    """Failures, rate, likelihood and cost of a campaign so far."""
    seen = store.campaigns.get(campaign)
    return Json(summarise(seen, store.episodes.totals(campaign)))


@router.get("/{campaign}/course", **documented(Course))
def get_course(store: Stored, campaign: CampaignId, per: Per = None) -> Json:
    """How failures, their likelihood and robustness moved over a campaign's episodes so far."""
    return Json(course_of(store, store.campaigns.get(campaign), per))


@router.get("/{campaign}/minimal", **documented(MinimalFailure))
def get_minimal_failure(store: Stored, campaign: CampaignId) -> Json:
    """How little noise a failure needs, so far: of a campaign that shrinks one."""
    return Json(minimal_failure(store, store.campaigns.get(campaign)))


@router.get("/{campaign}/digest", **documented(Digest))
def get_digest(store: Stored, campaign: CampaignId) -> Json:
    """SHA-256 over a campaign's results: equal for equal campaigns."""
    seen = store.campaigns.get(campaign)
    digest = seen.digest or store.episodes.digest(campaign)
    episodes = seen.counts.completed + seen.counts.failed
    return Json(Digest(campaign, digest, episodes, final=seen.digest is not None))
