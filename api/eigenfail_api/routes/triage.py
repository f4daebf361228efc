"""Routes of triage: state, owner, labels, ticket and notes of failure modes and episodes."""

from collections.abc import Callable
from typing import Annotated

from fastapi import APIRouter, Depends

from eigenfail.filters import parse_filter
from eigenfail.values import Page
from eigenfail.values.triage import (
    EpisodesTriage,
    ModesTriage,
    NoteText,
    Triage,
    TriageChange,
    TriageCount,
    TriageNote,
    check_change,
    check_note,
)
from eigenfail.wire.http import PREFIX
from eigenfail_api.openapi import document_route
from eigenfail_api.parameters import (
    AnalysisId,
    Before,
    CallerName,
    CampaignId,
    EpisodeIndex,
    Json,
    Limit,
    ModeNumber,
    Stored,
    body_of,
)
from eigenfail_services.store.triage import TriageSubject, episode_subject, mode_subject
from eigenfail_services.store.triage_rows import TriageKind

router = APIRouter(prefix=PREFIX, tags=["triage"])

MODES = "/analyses/{analysis}/modes"
EPISODES = "/campaigns/{campaign}/episodes"

Change = Annotated[TriageChange, Depends(body_of(TriageChange))]
Text = Annotated[NoteText, Depends(body_of(NoteText))]


def _find_mode(analysis: AnalysisId, mode: ModeNumber) -> TriageSubject:
    return mode_subject(analysis, mode)


def _find_episode(campaign: CampaignId, index: EpisodeIndex) -> TriageSubject:
    return episode_subject(campaign, index)


def _add_subject_routes(
    path: str, kind: TriageKind, words: str, find_subject: Callable[..., TriageSubject]
) -> None:
    """Add the routes of one subject of triage: its triage and its notes.

    Args:
        path: path of a subject.
        kind: kind of the subjects, which the names of the routes contain.
        words: a subject of this kind, in the descriptions of the routes.
        find_subject: dependency that reads the subject from the path.
    """

    @router.get(
        f"{path}/triage",
        name=f"get_{kind}_triage",
        description=f"Get the triage of {words}.",
        **document_route(Triage),
    )
    def get_triage(store: Stored, subject: Annotated[TriageSubject, Depends(find_subject)]) -> Json:
        return Json(store.triage.get(subject))

    @router.post(
        f"{path}/triage",
        name=f"triage_{kind}",
        description=f"Change the triage of {words}; fields that are left out do not change.",
        **document_route(Triage, body=TriageChange),
    )
    def change_triage(
        store: Stored,
        subject: Annotated[TriageSubject, Depends(find_subject)],
        change: Change,
        who: CallerName,
    ) -> Json:
        return Json(store.triage.change(subject, check_change(change), who))

    @router.get(
        f"{path}/notes",
        name=f"list_{kind}_notes",
        description=f"List the notes on {words}, newest first.",
        **document_route(Page[TriageNote]),
    )
    def list_notes(
        store: Stored,
        subject: Annotated[TriageSubject, Depends(find_subject)],
        limit: Limit = 100,
        before: Before = None,
    ) -> Json:
        return Json(store.triage.notes(subject, limit, before))

    @router.post(
        f"{path}/notes",
        name=f"add_{kind}_note",
        description=f"Add a note to {words}.",
        **document_route(TriageNote, body=NoteText),
    )
    def add_note(
        store: Stored,
        subject: Annotated[TriageSubject, Depends(find_subject)],
        given: Text,
        who: CallerName,
    ) -> Json:
        return Json(store.triage.add_note(subject, check_note(given.text), who))


@router.post(f"{MODES}/triage", **document_route(TriageCount, body=ModesTriage))
def triage_modes(
    store: Stored,
    analysis: AnalysisId,
    asked: Annotated[ModesTriage, Depends(body_of(ModesTriage))],
    who: CallerName,
) -> Json:
    """Change the triage of several failure modes: of all of them, or of none."""
    change = check_change(asked.change)
    return Json(store.triage.change_modes(analysis, asked.modes, change, who))


_add_subject_routes(f"{MODES}/{{mode}}", TriageKind.MODE, "a failure mode", _find_mode)


@router.post(f"{EPISODES}/triage", **document_route(TriageCount, body=EpisodesTriage))
def triage_episodes(
    store: Stored,
    campaign: CampaignId,
    asked: Annotated[EpisodesTriage, Depends(body_of(EpisodesTriage))],
    who: CallerName,
) -> Json:
    """Change the triage of all episodes that match a filter: of all of them, or of none."""
    where, change = parse_filter(asked.filter), check_change(asked.change)
    return Json(store.triage.change_episodes(campaign, where, change, who))


_add_subject_routes(f"{EPISODES}/{{index}}", TriageKind.EPISODE, "an episode", _find_episode)
