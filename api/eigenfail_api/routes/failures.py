"""The route of the failures of all campaigns."""

from typing import Annotated

from fastapi import APIRouter, Depends, Query

from eigenfail import plugins
from eigenfail.methods import traits_of
from eigenfail.values import failures
from eigenfail.values.campaign import CampaignFilter
from eigenfail.values.records import EpisodeRow, Page
from eigenfail.wire.http import PREFIX
from eigenfail_api.openapi import document_route
from eigenfail_api.parameters import LARGEST, Json, Project, Stored
from eigenfail_services.store.failures import MOST_FAILURES

router = APIRouter(prefix=PREFIX, tags=["episodes"])

Planner = Annotated[str | None, Query(description="Only of campaigns of this planner.")]
Version = Annotated[
    str | None, Query(description="Only of campaigns of this version of a planner.")
]
Method = Annotated[
    str | None,
    Query(
        description="Only of campaigns of this method; by default, campaigns that repeat earlier "
        "failures are left out."
    ),
]
Archived = Annotated[bool, Query(description="Whether those of archived campaigns are listed.")]
SortBy = Annotated[
    str, Query(alias="sort", description=f"Order: {', '.join(failures.FAILURE_ORDERS)}.")
]
MaxFailures = Annotated[
    int, Query(ge=1, le=MOST_FAILURES, description="Maximum number of failures on a page.")
]
After = Annotated[
    int | None,
    Query(ge=0, le=LARGEST, description="Only failures after this place (`next` of a page)."),
]


def parse_failures(
    project: Project = None,
    planner: Planner = None,
    planner_version: Version = None,
    method: Method = None,
    archived: Archived = False,
) -> failures.FailureFilter:
    """Return the filter of a request: all its conditions hold."""
    # Fields of a form that nobody filled in arrive as empty texts.
    campaign = CampaignFilter(
        method=method or None,
        project=project or None,
        planner_version=planner_version or None,
        archived=None if archived else False,
    )
    # A user who names a method wants its failures, even if they repeat earlier ones.
    return failures.FailureFilter(
        campaign, planner or None, () if method else list_repeating_methods()
    )


def list_repeating_methods() -> tuple[str, ...]:
    """Return the methods whose failures are earlier ones again."""
    names = plugins.names(plugins.METHODS)
    return tuple(name for name in names if not traits_of(name).finds_new)


@router.get("/failures", **document_route(Page[EpisodeRow]))
def list_failures(
    store: Stored,
    where: Annotated[failures.FailureFilter, Depends(parse_failures)],
    sort: SortBy = failures.MOST_SEVERE_FIRST,
    limit: MaxFailures = 50,
    after: After = None,
) -> Json:
    """List the collisions of all campaigns by severity, by default the most severe first."""
    descending = failures.parse_failure_sort(sort)
    return Json(store.failures.page(where, limit, after, most_severe_first=descending))
