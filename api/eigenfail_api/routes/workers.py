"""Routes of workers."""

from typing import Annotated

from fastapi import APIRouter, Query

from eigenfail.values import Page
from eigenfail.values.worker import DAY_S, Presence, Staffing, WorkerShare
from eigenfail.wire.http import PREFIX
from eigenfail_api.openapi import document_route
from eigenfail_api.parameters import CampaignId, Json, Stored
from eigenfail_services.campaigns.summary import (
    LATELY_S,
    count_present,
    find_staffing,
    find_worker_shares,
    list_recent_workers,
)

router = APIRouter(prefix=PREFIX, tags=["workers"])

Within = Annotated[
    int, Query(ge=1, le=DAY_S, description="Only workers with results in this last time [s].")
]


@router.get("/workers", **document_route(Page[WorkerShare]))
def list_workers(store: Stored, within_s: Within = LATELY_S) -> Json:
    """List workers with recent results, by campaign; only recent results are counted."""
    return Json(Page(list_recent_workers(store, within_s)))


@router.get("/workers/present", **document_route(Page[Presence]))
def list_present_workers(store: Stored) -> Json:
    """List connected workers, working or idle: host, start of the connection, versions."""
    return Json(Page(count_present(store)))


@router.get("/workers/staffing", **document_route(Staffing))
def get_staffing(store: Stored) -> Json:
    """Get the number of workers, and the last report of the services that start them."""
    return Json(find_staffing(store))


@router.get("/campaigns/{campaign}/workers", **document_route(Page[WorkerShare]))
def list_campaign_workers(store: Stored, campaign: CampaignId) -> Json:
    """List the workers that ran a campaign's episodes, most episodes first."""
    return Json(Page(find_worker_shares(store, store.campaigns.get(campaign))))
