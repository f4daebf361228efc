"""Triage of failure modes and episodes: the current one of each, and notes that only grow."""

from collections.abc import Callable, Iterable, Sequence
from typing import Any, NamedTuple

from sqlalchemy import Connection, bindparam, insert, select, update

from eigenfail.errors import InvalidValue
from eigenfail.filters import BY_INDEX, Conditions
from eigenfail.values import Page
from eigenfail.values.triage import (
    MOST_TRIAGED,
    UNTOUCHED,
    Triage,
    TriageChange,
    TriageCount,
    TriageNote,
    change_triage,
)
from eigenfail_services.store.analyses import require_analysis
from eigenfail_services.store.campaign_rows import lock_campaign, read_campaign
from eigenfail_services.store.clock import now_ms
from eigenfail_services.store.engine import Database, chunks
from eigenfail_services.store.errors import make_episode_error, make_mode_error
from eigenfail_services.store.listing import page_queries
from eigenfail_services.store.schema import (
    analyses,
    episode_index,
    episodes,
    modes,
    triage,
    triage_notes,
)
from eigenfail_services.store.triage_rows import TriageKind, join_labels, read_triage, to_triage


class TriageSubject(NamedTuple):
    """A failure mode or an episode.

    Attributes:
        kind: which of the two.
        parent: id of the analysis, or of the campaign.
        number: number of the mode, or index of the episode.
    """

    kind: TriageKind
    parent: int
    number: int


def mode_subject(analysis: int, number: int) -> TriageSubject:
    """Return a failure mode as a subject of triage."""
    return TriageSubject(TriageKind.MODE, analysis, number)


def episode_subject(campaign: int, index: int) -> TriageSubject:
    """Return an episode as a subject of triage."""
    return TriageSubject(TriageKind.EPISODE, campaign, index)


class _Order(NamedTuple):
    """A change, and the name of who makes it."""

    change: TriageChange
    who: str


def accept(_triage: Triage) -> None:
    """Let any triage be changed."""


class TriageStore:
    """Triage and notes of failure modes and episodes, each with the name of its author."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def get(self, subject: TriageSubject) -> Triage:
        """Return the triage of a mode or an episode.

        Raises:
            NotFound: no such mode or episode.
        """
        with self._database.reading() as connection:
            _require(connection, subject)
            return _read(connection, subject)

    def change(
        self,
        subject: TriageSubject,
        change: TriageChange,
        who: str,
        check: Callable[[Triage], None] = accept,
    ) -> Triage:
        """Change the triage of a mode or an episode, and return it.

        Args:
            subject: the mode or the episode.
            change: what changes.
            who: name of who makes the change.
            check: raises an error if the current triage is not the one to be changed; no other
                change comes between.

        Raises:
            NotFound: no such mode or episode.
            InvalidValue: it would have too many labels.
        """
        with self._database.writing() as connection:
            _lock(connection, subject.kind, subject.parent)
            _require(connection, subject)
            check(_read(connection, subject))
            _change(connection, subject.kind, subject.parent, [subject.number], _Order(change, who))
            return _read(connection, subject)

    def change_episodes(
        self, campaign: int, where: Conditions, change: TriageChange, who: str
    ) -> TriageCount:
        """Change the triage of all finished episodes that fulfil all conditions, or of none.

        Raises:
            NotFound: no such campaign.
            InvalidValue: these are more than `MOST_TRIAGED`, or one would have too many labels.
        """
        with self._database.writing() as connection:
            _lock(connection, TriageKind.EPISODE, campaign)
            chosen = _choose_episodes(connection, campaign, where)
            changed = _change(connection, TriageKind.EPISODE, campaign, chosen, _Order(change, who))
        return TriageCount(len(chosen), changed)

    def change_modes(
        self, analysis: int, numbers: Sequence[int], change: TriageChange, who: str
    ) -> TriageCount:
        """Change the triage of several modes of an analysis, or of none.

        Raises:
            NotFound: no such analysis, or it lacks one of the modes.
            InvalidValue: one would have too many labels.
        """
        chosen = sorted(set(numbers))
        with self._database.writing() as connection:
            _lock(connection, TriageKind.MODE, analysis)
            for number in chosen:
                _require(connection, mode_subject(analysis, number))
            changed = _change(connection, TriageKind.MODE, analysis, chosen, _Order(change, who))
        return TriageCount(len(chosen), changed)

    def add_note(self, subject: TriageSubject, text: str, author: str) -> TriageNote:
        """Add a note to a mode or an episode, and return it.

        Raises:
            NotFound: no such mode or episode.
        """
        at_ms = now_ms()
        values = {"at_ms": at_ms, "author": author, "text": text}
        statement = insert(triage_notes).values(**subject._asdict(), **values)
        with self._database.writing() as connection:
            _require(connection, subject)
            number = connection.execute(statement.returning(triage_notes.c.id)).scalar_one()
        return TriageNote(number, at_ms, author, text)

    def notes(
        self, subject: TriageSubject, limit: int, before: int | None = None
    ) -> Page[TriageNote]:
        """Return the notes on a mode or an episode, newest first, with ids below `before`.

        Raises:
            NotFound: no such mode or episode.
        """
        note = triage_notes.c
        query = (
            select(note.id, note.at_ms, note.author, note.text)
            .where(note.kind == subject.kind, note.parent == subject.parent)
            .where(note.number == subject.number)
            .order_by(note.id.desc())
            .limit(limit + 1)
        )
        if before is not None:
            query = query.where(note.id < before)
        with self._database.reading() as connection:
            _require(connection, subject)
            found = [TriageNote(*row) for row in connection.execute(query)]
        return Page(tuple(found[:limit]), found[limit - 1].id if len(found) > limit else None)

    def list_triaged(
        self, kind: TriageKind, parent: int, limit: int
    ) -> list[tuple[TriageSubject, Triage]]:
        """Return the modes of an analysis or the episodes of a campaign whose triage was changed.

        Args:
            kind: which of the two.
            parent: id of the analysis, or of the campaign.
            limit: how many are returned, those of the lowest numbers.
        """
        query = (
            select(triage)
            .where(triage.c.kind == kind, triage.c.parent == parent)
            .order_by(triage.c.number)
            .limit(limit)
        )
        with self._database.reading() as connection:
            return [
                (TriageSubject(kind, parent, row["number"]), to_triage(row))
                for row in connection.execute(query).mappings()
            ]

    def list_notes(
        self, kind: TriageKind, parent: int, limit: int
    ) -> list[tuple[TriageSubject, TriageNote]]:
        """Return the newest notes on modes of an analysis or on episodes of a campaign, in order.

        Args:
            kind: which of the two.
            parent: id of the analysis, or of the campaign.
            limit: how many are returned.
        """
        note = triage_notes.c
        query = (
            select(note.number, note.id, note.at_ms, note.author, note.text)
            .where(note.kind == kind, note.parent == parent)
            .order_by(note.id.desc())
            .limit(limit)
        )
        with self._database.reading() as connection:
            found = [
                (TriageSubject(kind, parent, number), TriageNote(*rest))
                for number, *rest in connection.execute(query)
            ]
        return sorted(found, key=lambda each: (each[0].number, each[1].id))


def _require(connection: Connection, subject: TriageSubject) -> None:
    """Raise NotFound if there is no such mode or episode."""
    _, parent, number = subject
    if subject.kind is TriageKind.MODE:
        require_analysis(connection, parent)
        query = select(modes.c.number).where(modes.c.analysis == parent, modes.c.number == number)
        error = make_mode_error(parent, number)
    else:
        read_campaign(connection, parent)
        query = select(episode_index).where(episodes.c.campaign == parent, episode_index == number)
        error = make_episode_error(parent, number)
    if connection.execute(query).first() is None:
        raise error


def _lock(connection: Connection, kind: TriageKind, parent: int) -> None:
    """Let one change at a time read and write the triage of a campaign or an analysis.

    Raises:
        NotFound: no such campaign or analysis.
    """
    if kind is TriageKind.EPISODE:
        lock_campaign(connection, parent)
        return
    connection.execute(
        select(analyses.c.id).where(analyses.c.id == parent).with_for_update(key_share=True)
    )
    require_analysis(connection, parent)


def _read(connection: Connection, subject: TriageSubject) -> Triage:
    kind, parent, number = subject
    return read_triage(connection, kind, parent, [number]).get(number, UNTOUCHED)


def _choose_episodes(connection: Connection, campaign: int, where: Conditions) -> list[int]:
    """Return the indices of the finished episodes that fulfil all conditions.

    Raises:
        InvalidValue: these are more than `MOST_TRIAGED`.
    """
    (query,) = page_queries(connection, campaign, None, where, BY_INDEX)
    chosen = list(connection.execute(query.limit(MOST_TRIAGED + 1)).scalars())
    if len(chosen) > MOST_TRIAGED:
        problem = f"it matches more than {MOST_TRIAGED:,} episodes."
        raise InvalidValue("filter", problem, "Add a condition, such as index < 20000.")
    return chosen


_CHANGED = ("state", "owner", "labels", "ticket", "changed_ms", "changed_by")
_UPDATE = (
    update(triage)
    .where(triage.c.kind == bindparam("of_kind"), triage.c.parent == bindparam("of_parent"))
    .where(triage.c.number == bindparam("of_number"))
    .values({name: bindparam(name) for name in _CHANGED})
)


def _change(
    connection: Connection, kind: TriageKind, parent: int, numbers: Iterable[int], order: _Order
) -> int:
    """Change the triage of locked modes or episodes; return how many are other than before."""
    at_ms, changed = now_ms(), 0
    for chunk in chunks(numbers):
        before = read_triage(connection, kind, parent, chunk)
        after = {
            number: change_triage(before.get(number, UNTOUCHED), order.change, at_ms, order.who)
            for number in chunk
        }
        is_other = [n for n in chunk if after[n] is not before.get(n, UNTOUCHED)]
        place = {"of_kind": kind, "of_parent": parent}
        updated = [
            {**place, "of_number": number, **_to_columns(after[number])}
            for number in is_other
            if number in before
        ]
        inserted = [
            {**TriageSubject(kind, parent, number)._asdict(), **_to_columns(after[number])}
            for number in is_other
            if number not in before
        ]
        if updated:
            connection.execute(_UPDATE, updated)
        if inserted:
            connection.execute(insert(triage), inserted)
        changed += len(is_other)
    return changed


def _to_columns(after: Triage) -> dict[str, Any]:
    values = {name: getattr(after, name) for name in _CHANGED}
    return values | {"labels": join_labels(after.labels)}
