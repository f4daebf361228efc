"""Routes of triage: state, owner, labels, ticket and notes of failure modes and episodes."""

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
    Precondition,
    Stored,
    body_of,
)
from eigenfail_services.store.triage import TriageSubject, episode_subject, mode_subject

router = APIRouter(prefix=PREFIX, tags=["triage"])

MODES = "/analyses/{analysis}/modes"
EPISODES = "/campaigns/{campaign}/episodes"
MODE = f"{MODES}/{{mode}}"
EPISODE = f"{EPISODES}/{{index}}"

Change = Annotated[TriageChange, Depends(body_of(TriageChange))]
Text = Annotated[NoteText, Depends(body_of(NoteText))]


def mode_subject_of(analysis: AnalysisId, mode: ModeNumber) -> TriageSubject:
    """Return the failure mode of a request."""
    return mode_subject(analysis, mode)


def episode_subject_of(campaign: CampaignId, index: EpisodeIndex) -> TriageSubject:
    """Return the episode of a request."""
    return episode_subject(campaign, index)


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


@router.get(f"{MODE}/triage", **document_route(Triage))
def get_mode_triage(store: Stored, analysis: AnalysisId, mode: ModeNumber) -> Json:
    """Get the triage of a failure mode."""
    return Json(store.triage.get(mode_subject(analysis, mode)))


@router.post(f"{MODE}/triage", **document_route(Triage, body=TriageChange))
def triage_mode(
    store: Stored,
    subject: Annotated[TriageSubject, Depends(mode_subject_of)],
    change: Change,
    who: CallerName,
    precondition: Precondition,
) -> Json:
    """Change the triage of a failure mode; fields that are left out do not change."""
    return Json(store.triage.change(subject, check_change(change), who, precondition))


@router.get(f"{MODE}/notes", **document_route(Page[TriageNote]))
def list_mode_notes(
    store: Stored,
    analysis: AnalysisId,
    mode: ModeNumber,
    limit: Limit = 100,
    before: Before = None,
) -> Json:
    """List the notes on a failure mode, newest first."""
    return Json(store.triage.notes(mode_subject(analysis, mode), limit, before))


@router.post(f"{MODE}/notes", **document_route(TriageNote, body=NoteText))
def add_mode_note(
    store: Stored, analysis: AnalysisId, mode: ModeNumber, given: Text, who: CallerName
) -> Json:
    """Add a note to a failure mode."""
    return Json(store.triage.add_note(mode_subject(analysis, mode), check_note(given.text), who))


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


@router.get(f"{EPISODE}/triage", **document_route(Triage))
def get_episode_triage(store: Stored, campaign: CampaignId, index: EpisodeIndex) -> Json:
    """Get the triage of an episode."""
    return Json(store.triage.get(episode_subject(campaign, index)))


@router.post(f"{EPISODE}/triage", **document_route(Triage, body=TriageChange))
def triage_episode(
    store: Stored,
    subject: Annotated[TriageSubject, Depends(episode_subject_of)],
    change: Change,
    who: CallerName,
    precondition: Precondition,
) -> Json:
    """Change the triage of an episode; fields that are left out do not change."""
    return Json(store.triage.change(subject, check_change(change), who, precondition))


@router.get(f"{EPISODE}/notes", **document_route(Page[TriageNote]))
def list_episode_notes(
    store: Stored,
    campaign: CampaignId,
    index: EpisodeIndex,
    limit: Limit = 100,
    before: Before = None,
) -> Json:
    """List the notes on an episode, newest first."""
    return Json(store.triage.notes(episode_subject(campaign, index), limit, before))


@router.post(f"{EPISODE}/notes", **document_route(TriageNote, body=NoteText))
def add_episode_note(
    store: Stored, campaign: CampaignId, index: EpisodeIndex, given: Text, who: CallerName
) -> Json:
    """Add a note to an episode."""
    return Json(
        store.triage.add_note(episode_subject(campaign, index), check_note(given.text), who)
    )
