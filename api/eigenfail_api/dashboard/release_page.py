"""The pages of releases: where versions of a planner were tested, and their failure modes."""

from collections.abc import Mapping
from typing import Annotated

from fastapi import APIRouter, Query
from fastapi.responses import HTMLResponse

from eigenfail.presentation import releases
from eigenfail.values.release import ModeStatus
from eigenfail_api.dashboard.rendering import page
from eigenfail_api.parameters import AnalysisId, CampaignId, ModeNumber, Stored
from eigenfail_api.routes.versions import RELEASES
from eigenfail_services.comparison.releases import (
    find_history,
    list_release_tables,
    list_tested_worlds,
    make_release_table,
)

MARKS: Mapping[ModeStatus, str] = {
    ModeStatus.FIRST_SEEN: "tone-bad",
    ModeStatus.STILL_THERE: "tone-active",
    ModeStatus.NOT_FOUND_AGAIN: "tone-good",
    ModeStatus.NOT_MET: "",
    ModeStatus.REGRESSED: "tone-bad",
    ModeStatus.UNDECIDED: "",
}
"""Class of the style of a status."""

SHOWN = 10
"""Newest scenarios of which the newest version is compared on the page of all."""


IN_NO_RELEASE = (
    "No history: the campaign names no version of the planner, its method finds no failures of its "
    "own, or the releases have these failures in another mode."
)


router = APIRouter(include_in_schema=False, default_response_class=HTMLResponse)

Project = Annotated[str, Query(max_length=80)]


@router.get("/releases", dependencies=[RELEASES])
def show_questions(store: Stored, project: Project = "") -> HTMLResponse:
    """Serve the scenarios that versions of a planner were tested in."""
    questions = list_tested_worlds(store, project or None)
    # A table costs a comparison of all versions: only the newest scenarios have one here.
    tables = list_release_tables(store, project or None, SHOWN)
    newest = [(table.question, releases.compare_newest(table)) for table in tables]
    return page(
        "releases.html",
        questions,
        newest=newest,
        project=project,
        changes=releases.CHANGES,
        marks=MARKS,
    )


@router.get("/releases/{campaign}", dependencies=[RELEASES])
def show_release(store: Stored, campaign: CampaignId) -> HTMLResponse:
    """Serve the versions that were tested as in a campaign, with their failure modes."""
    table = make_release_table(store, campaign)
    return page(
        "release.html",
        table,
        format_code=releases.format_code,
        format_status=releases.format_status,
        marks=MARKS,
    )


@router.get("/analyses/{analysis}/modes/{mode}/history", dependencies=[RELEASES])
def show_mode_history(store: Stored, analysis: AnalysisId, mode: ModeNumber) -> HTMLResponse:
    """Serve the history of a mode over the releases; the mode's page requests it once loaded."""
    seen = store.analyses.mode(analysis, mode)
    campaign, history = find_history(store, analysis, mode) or (None, None)
    return page(
        "mode_history.html",
        seen,
        address=f"/releases/{campaign}#mode-{history.number}" if history else "",
        sightings=history.sightings if history else (),
        format_status=releases.format_status,
        nothing=IN_NO_RELEASE,
    )
