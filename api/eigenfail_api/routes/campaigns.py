"""Campaigns: create, list, look at, steer, sum up."""

from typing import Annotated, Any, NamedTuple

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
from eigenfail.values.campaign_filter import CampaignFilter
from eigenfail.values.priority import PriorityChange
from eigenfail.wire.drafts import CampaignCheck
from eigenfail.wire.http import PREFIX, Digest
from eigenfail.wire.problems import problem_of
from eigenfail_api import steering
from eigenfail_api.bodies import Json, body_of, plain_body
from eigenfail_api.parameters import (
    LARGEST,
    Before,
    CampaignId,
    IdempotencyKey,
    Limit,
    MadeBy,
    Stored,
)
from eigenfail_api.schemas import FIELDS, SPECS, documented, documented_plain
from eigenfail_services.campaigns.bulk import read_many
from eigenfail_services.campaigns.checks import check_spec
from eigenfail_services.campaigns.clones import clone
from eigenfail_services.campaigns.course import course_of
from eigenfail_services.campaigns.drafts import completed, problems_of, read_draft
from eigenfail_services.campaigns.materials import check_references
from eigenfail_services.campaigns.minimal_failures import minimal_failure
from eigenfail_services.campaigns.stop_notes import stop_notes
from eigenfail_services.campaigns.summary import summaries_of, summarise

router = APIRouter(prefix=f"{PREFIX}/campaigns", tags=["campaigns"])

Per = Annotated[
    int | None,
    Query(ge=1, le=LARGEST, description="Episodes of a block; by the budget if not given."),
]
Search = Annotated[
    str | None,
    Query(description="Only those whose name contains this, in small or large letters."),
]
Fields = Annotated[dict[str, Any], Depends(plain_body(dict))]
Items = Annotated[list[Any], Depends(plain_body(list))]


class Chosen(NamedTuple):
    """Which campaigns are listed."""

    state: CampaignState | None
    suite: str | None
    where: CampaignFilter


def chosen_by(
    state: Annotated[CampaignState | None, Query(description="Only in this state.")] = None,
    suite: Annotated[str | None, Query(description="Only of this suite.")] = None,
    method: Annotated[str | None, Query(description="Only of this method.")] = None,
    search: Search = None,
) -> Chosen:
    """The campaigns of which all that is given holds."""
    return Chosen(state, suite, CampaignFilter(method, search))


def created(campaign: Campaign) -> Json:
    """The answer that a campaign has been created."""
    return Json(campaign, 201, {"Location": f"{PREFIX}/campaigns/{campaign.id}"})


@router.post("", **documented(Campaign, 201, body=CampaignSpec))
def create_campaign(
    store: Stored,
    spec: Annotated[CampaignSpec, Depends(body_of(CampaignSpec))],
    made_by: MadeBy,
    idempotency_key: IdempotencyKey = None,
) -> Json:
    """Queue a new campaign."""
    check_references(check_spec(spec), store)
    return created(store.campaigns.create(spec, idempotency_key, made_by))


@router.post("/check", **documented_plain(CampaignCheck, 200, FIELDS))
def check_campaign(store: Stored, fields: Fields) -> Json:
    """What a new campaign would be, or everything that is wrong with it; nothing is launched."""
    if problems := problems_of(fields, store):
        return Json(CampaignCheck(None, tuple(map(problem_of, problems))))
    spec = completed(read_draft(fields, store))
    return Json(CampaignCheck(spec, notes=tuple(stop_notes(spec))))


@router.post("/bulk", **documented_plain(Page[Campaign], 201, SPECS))
def create_campaigns(
    store: Stored, specs: Items, made_by: MadeBy, idempotency_key: IdempotencyKey = None
) -> Json:
    """Queue many new campaigns in the order of the list: all of them, or none."""
    made = store.campaigns.create_many(read_many(specs, store), idempotency_key, made_by)
    return Json(Page(made), 201)


@router.get("", **documented(Page[Campaign]))
def list_campaigns(
    store: Stored,
    chosen: Annotated[Chosen, Depends(chosen_by)],
    limit: Limit = 50,
    before: Before = None,
) -> Json:
    """Campaigns, newest first."""
    return Json(store.campaigns.page(limit, before, *chosen))


@router.get("/summaries", **documented(Page[Summary]))
def list_summaries(store: Stored, limit: Limit = 50, before: Before = None) -> Json:
    """Failures, rate, likelihood and cost of campaigns, newest first."""
    page = store.campaigns.page(limit, before)
    return Json(Page(tuple(summaries_of(store, page.items)), page.next))


@router.get("/{campaign}", **documented(Campaign))
def get_campaign(store: Stored, campaign: CampaignId) -> Json:
    """A campaign as it stands."""
    return Json(store.campaigns.get(campaign))


@router.post("/{campaign}/clone", **documented_plain(Campaign, 201, FIELDS))
def clone_campaign(
    store: Stored,
    campaign: CampaignId,
    changes: Fields,
    made_by: MadeBy,
    idempotency_key: IdempotencyKey = None,
) -> Json:
    """Queue a new campaign like an earlier one, with other values for some of its fields."""
    spec = clone(store.campaigns.get(campaign).spec, changes, store)
    return created(store.campaigns.create(spec, idempotency_key, made_by))


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


@router.post("/{campaign}/priority", **documented(Campaign, body=PriorityChange))
def prioritise_campaign(
    store: Stored,
    campaign: CampaignId,
    change: Annotated[PriorityChange, Depends(body_of(PriorityChange))],
) -> Json:
    """Give a campaign that has not ended another priority, from now on."""
    return Json(store.campaigns.prioritise(campaign, change.priority))


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
