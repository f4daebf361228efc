"""The pages of releases: where versions of a planner were tested, and their failure modes."""

from collections.abc import Mapping
from typing import Annotated

import msgspec
from fastapi import APIRouter, Query
from fastapi.responses import HTMLResponse

from eigenfail.presentation import releases
from eigenfail.presentation.figures import format_count
from eigenfail.values.release import ModeSighting, ModeStatus, ReleaseQuestion, ReleaseTable
from eigenfail.values.triage import TriageState
from eigenfail_api.dashboard.rendering import page
from eigenfail_api.parameters import AnalysisId, CampaignId, ModeNumber, Stored
from eigenfail_api.routes.releases import RELEASES
from eigenfail_services.comparison.releases import (
    find_history,
    list_questions,
    list_release_tables,
    make_release_table,
)
from eigenfail_services.store import Store

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


class SightingCell(msgspec.Struct, frozen=True, kw_only=True):
    """A failure mode in a version.

    Attributes:
        version: the version.
        status: what became of the mode, in words.
        mark: class of the style.
        words: why.
        address: page of the mode in that version; empty without failures.
    """

    version: str
    status: str
    mark: str = ""
    words: str = ""
    address: str = ""


class ModeLine(msgspec.Struct, frozen=True, kw_only=True):
    """A failure mode over the versions.

    Attributes:
        state: state of the triage of its newest sighting in words; empty if it is new.
    """

    number: int
    name: str
    state: str
    cells: tuple[SightingCell, ...]


class VersionLine(msgspec.Struct, frozen=True, kw_only=True):
    """A version with its campaigns.

    Attributes:
        code: fingerprints of its code.
        is_mixed: whether its campaigns did not have the same code.
        problem: why its failure modes are not compared.
    """

    version: str
    campaigns: tuple[int, ...]
    episodes: str
    failures: str
    code: str
    is_mixed: bool
    problem: str


class ReleaseView(msgspec.Struct, frozen=True, kw_only=True):
    """The page of the versions of a planner in one scenario."""

    table: ReleaseTable
    versions: tuple[VersionLine, ...]
    modes: tuple[ModeLine, ...]


class ModeChangeLine(msgspec.Struct, frozen=True, kw_only=True):
    """Failure modes with one status in the newest version.

    Attributes:
        change: what became of them, in words.
        mark: class of the style.
        modes: name and address of each.
    """

    change: str
    mark: str
    modes: tuple[tuple[str, str], ...]


class NewestPart(msgspec.Struct, frozen=True, kw_only=True):
    """The newest version of a planner in one scenario against the one before it."""

    campaign: int
    title: str
    asked: str
    words: str
    changes: tuple[ModeChangeLine, ...]


class QuestionsView(msgspec.Struct, frozen=True, kw_only=True):
    """The page of all scenarios in which versions were tested.

    Attributes:
        newest: the newest version against the one before it, of the newest scenarios.
    """

    newest: tuple[NewestPart, ...]
    questions: tuple[ReleaseQuestion, ...]
    project: str


def make_newest_part(table: ReleaseTable) -> NewestPart:
    """Return the newest version of a comparison against the one before it."""
    asked, found = table.question, releases.compare_newest(table)
    return NewestPart(
        campaign=asked.campaign,
        title=f"{asked.planner} in {asked.scenario}",
        asked=f"Required: {asked.requirements}. Method: {asked.method}.",
        words=found.words,
        changes=tuple(
            ModeChangeLine(
                change=releases.CHANGES[status].capitalize(),
                mark=MARKS[status],
                modes=tuple(
                    (each.name, f"/releases/{asked.campaign}#mode-{each.number}") for each in modes
                ),
            )
            for status, modes in found.modes.items()
        ),
    )


def make_release_view(table: ReleaseTable) -> ReleaseView:
    """Return the page of the versions of a planner in one scenario."""
    versions = tuple(
        VersionLine(
            version=each.version,
            campaigns=each.campaigns,
            episodes=format_count(each.episodes),
            failures=format_count(each.failures),
            code=releases.format_code(each),
            is_mixed=len(each.fingerprints) > 1,
            problem=each.problem,
        )
        for each in table.releases
    )
    modes = tuple(
        ModeLine(
            number=each.number,
            name=each.name,
            state="" if each.state is TriageState.NEW else each.state.words,
            cells=tuple(map(make_cell, each.sightings)),
        )
        for each in table.modes
    )
    return ReleaseView(table=table, versions=versions, modes=modes)


def make_cell(sighting: ModeSighting) -> SightingCell:
    """Return a failure mode in a version for a page."""
    if sighting.status is None:
        status = releases.format_status(sighting)
        return SightingCell(version=sighting.version, status=status, words=sighting.words)
    has_failures = sighting.analysis is not None
    return SightingCell(
        version=sighting.version,
        status=releases.format_status(sighting).capitalize(),
        mark="" if sighting.is_baseline else MARKS[sighting.status],
        words=sighting.words,
        address=f"/analyses/{sighting.analysis}/modes/{sighting.mode}" if has_failures else "",
    )


class ModeHistory(msgspec.Struct, frozen=True, kw_only=True):
    """A failure mode over the releases: the part of its page that comes later.

    Attributes:
        address: page of the releases; empty where the mode belongs to none.
        cells: what became of the mode, by version.
        nothing: why there are none, if so.
    """

    analysis: int
    mode: int
    address: str = ""
    cells: tuple[SightingCell, ...] = ()
    nothing: str = ""


def make_history(store: Store, analysis: int, mode: int) -> ModeHistory:
    """Return what became of a mode over the releases.

    Raises:
        NotFound: no such analysis or mode.
    """
    store.analyses.mode(analysis, mode)
    if (found := find_history(store, analysis, mode)) is None:
        return ModeHistory(analysis=analysis, mode=mode, nothing=IN_NO_RELEASE)
    campaign, history = found
    return ModeHistory(
        analysis=analysis,
        mode=mode,
        address=f"/releases/{campaign}#mode-{history.number}",
        cells=tuple(map(make_cell, history.sightings)),
    )


IN_NO_RELEASE = (
    "No history: the campaign names no version of the planner, its method finds no failures of its "
    "own, or the releases have these failures in another mode."
)


router = APIRouter(include_in_schema=False, default_response_class=HTMLResponse)

Project = Annotated[str, Query(max_length=80)]


@router.get("/releases", dependencies=[RELEASES])
def show_questions(store: Stored, project: Project = "") -> HTMLResponse:
    """Serve the scenarios in which versions of a planner were tested."""
    tables = list_release_tables(store, project or None, SHOWN)
    view = QuestionsView(
        newest=tuple(map(make_newest_part, tables)),
        questions=list_questions(store, project or None),
        project=project,
    )
    return page("releases.html", view)


@router.get("/releases/{campaign}", dependencies=[RELEASES])
def show_release(store: Stored, campaign: CampaignId) -> HTMLResponse:
    """Serve the versions that were tested as in a campaign, with their failure modes."""
    return page("release.html", make_release_view(make_release_table(store, campaign)))


@router.get("/analyses/{analysis}/modes/{mode}/history", dependencies=[RELEASES])
def show_mode_history(store: Stored, analysis: AnalysisId, mode: ModeNumber) -> HTMLResponse:
    """Serve what became of a mode over the releases; its page asks for it once it stands."""
    return page("mode_history.html", make_history(store, analysis, mode))
