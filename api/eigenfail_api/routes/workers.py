"""Who runs the episodes."""

from typing import Annotated

from fastapi import APIRouter, Query

from eigenfail.values import Page
from eigenfail.values.worker import DAY_S, Presence, Staffing, WorkerShare
from eigenfail.wire.http import PREFIX
from eigenfail_api.bodies import Json
from eigenfail_api.parameters import CampaignId, Stored
from eigenfail_api.schemas import documented
from eigenfail_services.campaigns.crew import LATELY_S, lately, present, staffing, workers_of

router = APIRouter(prefix=PREFIX, tags=["workers"])

Within = Annotated[
    int, Query(ge=1, le=DAY_S, description="Whose results came in so many seconds [s].")
]


@router.get("/workers", **documented(Page[WorkerShare]))
def list_workers(store: Stored, within_s: Within = LATELY_S) -> Json:
    """Who brought results lately, and of which campaigns; only those results are counted."""
    return Json(Page(lately(store, within_s)))


@router.get("/workers/present", **documented(Page[Presence]))
def list_present_workers(store: Stored) -> Json:
    """Who is connected now, at work or not: where each runs, since when, with which versions."""
    return Json(Page(present(store)))


@router.get("/workers/staffing", **documented(Staffing))
def get_staffing(store: Stored) -> Json:
    """How many workers are there, and what the services said last of those that they start."""
    return Json(staffing(store))


@router.get("/campaigns/{campaign}/workers", **documented(Page[WorkerShare]))
def list_campaign_workers(store: Stored, campaign: CampaignId) -> Json:
    """Who ran the episodes of a campaign; who ran most comes first."""
    return Json(Page(workers_of(store, store.campaigns.get(campaign))))
