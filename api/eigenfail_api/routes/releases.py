"""Routes of releases: the versions of planners, and their failure modes."""

from typing import Annotated

from fastapi import APIRouter, Depends, Query

from eigenfail.values.records import Page
from eigenfail.values.release import ReleaseQuestion, ReleaseTable
from eigenfail.wire.http import PREFIX
from eigenfail_api.concurrency import ConcurrencyLimit
from eigenfail_api.openapi import document_route
from eigenfail_api.parameters import CampaignId, Json, Stored
from eigenfail_services.comparison.releases import list_questions, make_release_table

router = APIRouter(prefix=PREFIX, tags=["campaigns"])

# Both routes read up to 2,000 campaigns, so a crowd of requests is refused.
RELEASES = Depends(ConcurrencyLimit("releases"), scope="function")

Project = Annotated[str | None, Query(description="Only campaigns of this project.")]


@router.get("/releases", dependencies=[RELEASES], **document_route(Page[ReleaseQuestion]))
def list_releases(store: Stored, project: Project = None) -> Json:
    """List the scenarios in which versions of a planner were tested, the newest first."""
    return Json(Page(list_questions(store, project)))


@router.get("/releases/{campaign}", dependencies=[RELEASES], **document_route(ReleaseTable))
def get_release_table(store: Stored, campaign: CampaignId) -> Json:
    """Get the versions tested as in a campaign, with what became of each failure mode."""
    return Json(make_release_table(store, campaign))
