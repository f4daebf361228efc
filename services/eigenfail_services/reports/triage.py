"""Triage of the modes and episodes of a report, with the notes on them."""

from collections.abc import Iterator
from typing import NamedTuple

from eigenfail.presentation.figures import UNKNOWN, count_noun, format_utc
from eigenfail.values.report import Cell, ReportSection
from eigenfail.values.triage import UNTOUCHED, Triage
from eigenfail_services.reports.material import Material, Subject
from eigenfail_services.reports.page import ReportPart, make_table
from eigenfail_services.store import Store
from eigenfail_services.store.triage import TriageSubject
from eigenfail_services.store.triage_rows import TriageKind

MOST_SHOWN = 1_000
"""Modes or episodes of a campaign whose triage stands in a report, those of the lowest numbers."""

MOST_NOTES = 1_000
"""Notes on the modes or episodes of a campaign that stand in a report, the newest ones."""

TRIAGE, NOTES = "triage", "triage-notes"

_PLACE = (
    ("campaign", "Campaign"),
    ("kind", "Kind"),
    ("analysis", "Analysis"),
    ("number", "Number"),
)

TRIAGE_COLUMNS = (
    *_PLACE,
    ("name", "Name"),
    ("state", "State"),
    ("owner", "Owner"),
    ("labels", "Labels"),
    ("ticket", "Ticket"),
    ("changed", "Changed last"),
    ("changed_by", "Changed by"),
)

NOTE_COLUMNS = (*_PLACE, ("added", "Added"), ("author", "Author"), ("text", "Note"))

HOW_TO_READ = (
    "Triage is an assessment of the results by people, and no part of them: it enters no digest. "
    "It stands here as it was when the report was made: all modes of the newest analysis, and the "
    "episodes whose triage was changed."
)


class _Triaged(NamedTuple):
    """A mode or an episode with its triage.

    Attributes:
        name: name of the mode; empty for an episode.
    """

    campaign: int
    subject: TriageSubject
    triage: Triage
    name: str = ""


def make_triage(material: Material) -> ReportPart | None:
    """Return the triage of modes and episodes; None without a mode, a change or a note."""
    found = [each for subject in material.subjects for each in _list_all(material.store, subject)]
    notes = [
        (subject.id, place, note)
        for subject in material.subjects
        for kind, parent in _list_parents(subject)
        for place, note in material.store.triage.list_notes(kind, parent, MOST_NOTES)
    ]
    if not found and not notes:
        return None
    tables = (
        make_table(TRIAGE, "Triage", TRIAGE_COLUMNS, [*map(_make_row, found)], _BOUND),
        make_table(
            NOTES,
            "Notes",
            NOTE_COLUMNS,
            [
                (*_list_place(campaign, place), format_utc(note.at_ms), note.author, note.text)
                for campaign, place, note in notes
            ],
            _NOTES_BOUND,
        ),
    )
    section = ReportSection(
        name="triage",
        title="Triage",
        words=(HOW_TO_READ, *_count_states(found)),
        tables=tables,
    )
    return ReportPart(section)


_BOUND = f"At most {MOST_SHOWN:,} modes and {MOST_SHOWN:,} episodes of each campaign."
_NOTES_BOUND = f"At most the newest {MOST_NOTES:,} notes on modes and on episodes of each campaign."


def _list_parents(subject: Subject) -> Iterator[tuple[TriageKind, int]]:
    if subject.analysis is not None:
        yield TriageKind.MODE, subject.analysis.id
    yield TriageKind.EPISODE, subject.id


def _list_all(store: Store, subject: Subject) -> Iterator[_Triaged]:
    """Yield all modes of the newest analysis, and the episodes that were triaged."""
    if subject.analysis is not None:
        analysis = subject.analysis.id
        changed = dict(store.triage.list_triaged(TriageKind.MODE, analysis, MOST_SHOWN))
        for mode in store.analyses.modes(analysis)[:MOST_SHOWN]:
            place = TriageSubject(TriageKind.MODE, analysis, mode.number)
            yield _Triaged(subject.id, place, changed.get(place, UNTOUCHED), mode.name)
    for place, triage in store.triage.list_triaged(TriageKind.EPISODE, subject.id, MOST_SHOWN):
        yield _Triaged(subject.id, place, triage)


def _count_states(found: list[_Triaged]) -> Iterator[str]:
    """Yield how many modes and episodes are in each state, in a sentence for each campaign."""
    for campaign in dict.fromkeys(each.campaign for each in found):
        for kind in TriageKind:
            ours = [
                each.triage.state.words
                for each in found
                if (each.campaign, each.subject.kind) == (campaign, kind)
            ]
            if ours:
                states = (f"{ours.count(state)} {state}" for state in sorted(set(ours)))
                count = count_noun(len(ours), kind.value)
                yield f"Campaign {campaign}: {count}: {', '.join(states)}."


def _make_row(each: _Triaged) -> tuple[Cell, ...]:
    triage = each.triage
    return (
        *_list_place(each.campaign, each.subject),
        each.name,
        triage.state.words,
        triage.owner,
        ", ".join(triage.labels),
        triage.ticket,
        UNKNOWN if triage.changed_ms is None else format_utc(triage.changed_ms),
        triage.changed_by,
    )


def _list_place(campaign: int, subject: TriageSubject) -> tuple[Cell, ...]:
    is_mode = subject.kind is TriageKind.MODE
    return (campaign, subject.kind.value, subject.parent if is_mode else None, subject.number)
