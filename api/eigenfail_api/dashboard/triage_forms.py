"""Triage on the pages of an analysis, a failure mode, an episode, and a list of episodes.

The forms work without JavaScript: each leads back to the page that it is on.
"""

import re
from collections.abc import Mapping
from typing import Annotated
from urllib.parse import parse_qsl, urlencode

import msgspec
from fastapi import APIRouter, Depends, HTTPException, Request
from fastapi.responses import RedirectResponse
from markupsafe import Markup

from eigenfail.errors import Conflict, InvalidValue
from eigenfail.filters import parse_filter
from eigenfail.settings import refuse_hidden
from eigenfail.values.triage import (
    LONGEST_LABEL,
    LONGEST_NOTE,
    LONGEST_OWNER,
    LONGEST_TICKET,
    MOST_LABELS,
    Triage,
    TriageChange,
    TriageState,
    check_change,
    check_note,
)
from eigenfail.wire.http import read_fields
from eigenfail_api.access.change_details import record_form
from eigenfail_api.dashboard.rendering import write_time
from eigenfail_api.parameters import (
    AnalysisId,
    CallerName,
    CampaignId,
    EpisodeIndex,
    ModeNumber,
    Stored,
    read_within,
)
from eigenfail_services.store import Store
from eigenfail_services.store.triage import TriageSubject, episode_subject, mode_subject
from eigenfail_services.store.triage_rows import TriageKind

NOTES_ON_PAGE = 50
MOST_FIELDS = 100
SEE_OTHER = 303
VERSION = re.compile(r"\d{1,15}", re.ASCII)

STATES = tuple((state.value, state.words) for state in TriageState)
"""Values and words of the states, for a choice."""


class TriageChoices(msgspec.Struct, frozen=True):
    """What a form for triage offers and takes: states, and most characters of its texts."""

    states: tuple[tuple[str, str], ...] = STATES
    longest_owner: int = LONGEST_OWNER
    longest_labels: int = MOST_LABELS * (LONGEST_LABEL + 2)
    longest_ticket: int = LONGEST_TICKET
    longest_note: int = LONGEST_NOTE


CHOICES = TriageChoices()


class NoteLine(msgspec.Struct, frozen=True):
    """A note as text."""

    author: str
    written: str
    text: str


class TriageView(msgspec.Struct, frozen=True, kw_only=True):
    """The triage of a mode or an episode on its page.

    Attributes:
        address: address of that page.
        subject: the mode or the episode in words.
        triage: its triage.
        changed: when and by whom it was changed last; empty if it never was.
        labels: its labels, with commas between them.
        notes: the newest notes on it, newest first.
        has_more: whether there are older notes.
        command: command that lists all notes.
    """

    address: str
    subject: str
    triage: Triage
    changed: str
    labels: str
    notes: tuple[NoteLine, ...]
    has_more: bool
    command: str
    choices: TriageChoices = CHOICES


def make_triage_view(store: Store, subject: TriageSubject) -> TriageView:
    """Return the triage of a mode or an episode that exists."""
    found, page = store.triage.get(subject), store.triage.notes(subject, NOTES_ON_PAGE)
    by = f", by {found.changed_by}" if found.changed_by else ""
    at = write_time(found.changed_ms)
    return TriageView(
        address=find_address(subject),
        subject=subject.kind.value,
        triage=found,
        changed="" if found.changed_ms is None else Markup("{}{}").format(at, by),
        labels=", ".join(found.labels),
        notes=tuple(
            NoteLine(note.author, write_time(note.at_ms), note.text) for note in page.items
        ),
        has_more=page.next is not None,
        command=_write_command(subject),
    )


def describe_triage(state: TriageState, owner: str) -> str:
    """Return state and owner in words; empty for the state `new` without an owner."""
    words = "" if state is TriageState.NEW else state.words
    return ", ".join(filter(None, (words, owner)))


def find_address(subject: TriageSubject) -> str:
    """Return the address of the page of a mode or an episode."""
    if subject.kind is TriageKind.MODE:
        return f"/analyses/{subject.parent}/modes/{subject.number}"
    return f"/campaigns/{subject.parent}/episodes/{subject.number}"


def _write_command(subject: TriageSubject) -> str:
    if subject.kind is TriageKind.MODE:
        return f"eigenfail mode notes {subject.parent} {subject.number}"
    return f"eigenfail episode notes {subject.parent}/{subject.number}"


router = APIRouter(include_in_schema=False)

MODES = "/analyses/{analysis}/modes"
MODE = f"{MODES}/{{mode}}"
EPISODES = "/campaigns/{campaign}/episodes"
EPISODE = f"{EPISODES}/{{index}}"


async def read_form(request: Request) -> dict[str, str]:
    """Return the fields of a form; an empty one has an empty text.

    Raises:
        HTTPException: 400, the body is no form.
        InvalidValue: a text has an invisible character.
    """
    body = await read_within(request)
    try:
        pairs = parse_qsl(body.decode(), keep_blank_values=True, max_num_fields=MOST_FIELDS)
    except ValueError as error:
        raise HTTPException(400, f"The form is invalid: {error}.") from None
    form = dict(pairs)
    refuse_hidden(form)
    record_form(request.scope, form)
    return form


Form = Annotated[dict[str, str], Depends(read_form)]


def read_change(form: Mapping[str, str]) -> TriageChange:
    """Return the change of a form that shows the whole triage.

    Raises:
        InvalidValue: a value is outside its bounds.
    """
    given = {name: form.get(name) for name in ("state", "owner", "ticket")}
    labels = split_labels(form["labels"]) if "labels" in form else None
    return check_change(read_fields({**given, "labels": labels}, TriageChange))


def read_version(form: Mapping[str, str]) -> int | None:
    """Return when the triage that a form shows was changed last; None if it never was. [ms]

    Raises:
        InvalidValue: it is no such time.
    """
    text = form.get("changed_ms", "")
    if text and not VERSION.fullmatch(text):
        raise InvalidValue(
            "changed_ms", "it is not a time in milliseconds.", "Open the page again."
        )
    return int(text) if text else None


def read_addition(form: Mapping[str, str]) -> TriageChange:
    """Return the change of a form for several; empty fields change nothing.

    Raises:
        InvalidValue: a value is outside its bounds.
    """
    given = {name: form.get(name) or None for name in ("state", "owner")}
    labels = split_labels(form.get("labels", ""))
    return check_change(read_fields({**given, "add_labels": labels}, TriageChange))


def split_labels(text: str) -> list[str]:
    """Return the labels of a text with commas between them."""
    return [label.strip() for label in text.split(",") if label.strip()]


def return_to(address: str) -> RedirectResponse:
    """Return the answer that leads back to the triage of a page."""
    return RedirectResponse(f"{address}#triage", SEE_OTHER)


def _add_note(store: Store, subject: TriageSubject, text: str, who: str) -> RedirectResponse:
    store.triage.get(subject)  # that it exists comes before what its note says
    store.triage.add_note(subject, check_note(text), who)
    return return_to(find_address(subject))


def _change_triage(
    store: Store, subject: TriageSubject, form: Mapping[str, str], who: str
) -> RedirectResponse:
    shown_ms = read_version(form)

    def refuse_newer(found: Triage) -> None:
        if found.changed_ms != shown_ms:
            by = f", by {found.changed_by}" if found.changed_by else ""
            raise Conflict(
                f"The triage of this {subject.kind.value} was changed meanwhile{by}.",
                "Open the page again, and change what it shows now.",
            )

    store.triage.change(subject, read_change(form), who, refuse_newer)
    return return_to(find_address(subject))


@router.post(f"{MODES}/triage")
def triage_modes(
    store: Stored, analysis: AnalysisId, form: Form, who: CallerName
) -> RedirectResponse:
    """Change the triage of the selected failure modes."""
    known = store.analyses.modes(analysis)
    chosen = [mode.number for mode in known if f"mode-{mode.number}" in form]
    if not chosen:
        raise InvalidValue("modes", "none is selected.", "Select at least one.")
    count = store.triage.change_modes(analysis, chosen, read_addition(form), who)
    return return_to(f"/analyses/{analysis}?{urlencode({'changed': count.changed})}")


@router.post(f"{MODE}/triage")
def triage_mode(
    store: Stored, analysis: AnalysisId, mode: ModeNumber, form: Form, who: CallerName
) -> RedirectResponse:
    """Change the triage of a failure mode."""
    return _change_triage(store, mode_subject(analysis, mode), form, who)


@router.post(f"{MODE}/notes")
def add_mode_note(
    store: Stored, analysis: AnalysisId, mode: ModeNumber, form: Form, who: CallerName
) -> RedirectResponse:
    """Add a note to a failure mode."""
    return _add_note(store, mode_subject(analysis, mode), form.get("text", ""), who)


@router.post(f"{EPISODE}/triage")
def triage_episode(
    store: Stored, campaign: CampaignId, index: EpisodeIndex, form: Form, who: CallerName
) -> RedirectResponse:
    """Change the triage of an episode."""
    return _change_triage(store, episode_subject(campaign, index), form, who)


@router.post(f"{EPISODE}/notes")
def add_episode_note(
    store: Stored, campaign: CampaignId, index: EpisodeIndex, form: Form, who: CallerName
) -> RedirectResponse:
    """Add a note to an episode."""
    return _add_note(store, episode_subject(campaign, index), form.get("text", ""), who)


@router.post(f"{EPISODES}/triage")
def triage_episodes(
    store: Stored, campaign: CampaignId, form: Form, who: CallerName
) -> RedirectResponse:
    """Change the triage of all episodes that match the filter of the list."""
    text = form.get("filter", "").strip()
    change = read_addition(form)
    count = store.triage.change_episodes(campaign, parse_filter(text), change, who)
    query = urlencode({"filter": text, "changed": count.changed})
    return return_to(f"/campaigns/{campaign}/episodes?{query}")
