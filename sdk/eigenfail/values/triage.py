"""Triage of failure modes and episodes: state, owner, labels, ticket and notes.

None of it enters a digest: triage is an assessment of a result, and no part of it.
"""

from collections.abc import Iterable
from enum import StrEnum
from typing import Annotated
from urllib.parse import urlsplit

import msgspec

from eigenfail.errors import InvalidValue
from eigenfail.settings import Ordinal
from eigenfail.values.showing import Tabular

LONGEST_OWNER = 80
LONGEST_LABEL = 40
LONGEST_TICKET = 500
LONGEST_NOTE = 4_000
MOST_LABELS = 20
MOST_TRIAGED = 20_000
"""Most episodes that one request changes: nothing else is written to the database meanwhile."""

SCHEMES = ("http", "https")


class TriageState(StrEnum):
    """State of the triage of a failure mode or an episode.

    `new`: not assessed yet. `confirmed`: a fault of the planner. `known`: a fault that was found
    before. `fixed`: a fault that a later version does not have. `not_a_bug`: needs no change.
    """

    NEW = "new"
    CONFIRMED = "confirmed"
    KNOWN = "known"
    FIXED = "fixed"
    NOT_A_BUG = "not_a_bug"

    @property
    def words(self) -> str:
        """The state as pages and tables show it."""
        return "not a bug" if self is TriageState.NOT_A_BUG else self.value


class Triage(msgspec.Struct, frozen=True):
    """Current triage of a failure mode or of an episode.

    Attributes:
        state: state of the triage.
        owner: who works on it; empty without an owner.
        labels: words by which it is found, in alphabetical order.
        ticket: address of its ticket, beginning with http:// or https://; empty without one.
        changed_ms: when it was changed last; None if it never was. [ms since 1970]
        changed_by: name of the key that changed it last; `loopback` or `network` where no key is
            required.
    """

    state: TriageState = TriageState.NEW
    owner: str = ""
    labels: tuple[str, ...] = ()
    ticket: str = ""
    changed_ms: int | None = None
    changed_by: str = ""


UNTOUCHED = Triage()


_Owner = Annotated[str, msgspec.Meta(max_length=LONGEST_OWNER)]
_Ticket = Annotated[str, msgspec.Meta(max_length=LONGEST_TICKET)]
_Labels = Annotated[tuple[str, ...], msgspec.Meta(max_length=MOST_LABELS)]


class TriageChange(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A change of triage; fields that are null do not change.

    Attributes:
        state: the new state.
        owner: the new owner; empty for none.
        labels: all labels that it is to have from now on.
        add_labels: labels that it is to have besides.
        remove_labels: labels that it is not to have any more.
        ticket: address of its ticket; empty for none.
    """

    state: TriageState | None = None
    owner: _Owner | None = None
    labels: _Labels | None = None
    add_labels: _Labels = ()
    remove_labels: _Labels = ()
    ticket: _Ticket | None = None


class EpisodesTriage(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A change of triage of all episodes of a campaign that match a filter.

    Attributes:
        filter: conditions, as for the list of episodes; empty for every episode.
        change: what changes.
    """

    filter: str
    change: TriageChange


class ModesTriage(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A change of triage of several failure modes of an analysis.

    Attributes:
        modes: numbers of the modes, from 1.
        change: what changes.
    """

    modes: Annotated[tuple[Ordinal, ...], msgspec.Meta(min_length=1, max_length=1_000)]
    change: TriageChange


class TriageCount(msgspec.Struct, frozen=True):
    """What a change of several modes or episodes did.

    Attributes:
        matched: how many were selected.
        changed: how many of them are other than before.
    """

    matched: int
    changed: int


class NoteText(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A note that is to be added."""

    text: Annotated[str, msgspec.Meta(min_length=1, max_length=LONGEST_NOTE)]


class TriageNote(Tabular, msgspec.Struct, frozen=True):
    """A note on a failure mode or on an episode; notes are never changed or deleted.

    Attributes:
        id: its id.
        at_ms: when it was added. [ms since 1970]
        author: name of the key that added it; `loopback` or `network` where no key is required.
        text: what it says.
    """

    id: int
    at_ms: int
    author: str
    text: str


class TriageFilter(msgspec.Struct, frozen=True):
    """What the triage of a failure mode must be; None where anything will do.

    Attributes:
        state: its state.
        owner: its owner; empty for none.
        label: a label that it has.
    """

    state: TriageState | None = None
    owner: str | None = None
    label: str | None = None

    def holds(self, state: TriageState, owner: str, labels: tuple[str, ...]) -> bool:
        """Whether triage fulfils the filter."""
        return (
            self.state in {None, state}
            and self.owner in {None, owner}
            and (self.label is None or self.label in labels)
        )


ANY_TRIAGE = TriageFilter()


def change_triage(before: Triage, change: TriageChange, at_ms: int, who: str) -> Triage:
    """Return the triage after a change; the same object where nothing is other than before.

    Raises:
        InvalidValue: it would have more than `MOST_LABELS` labels.
    """
    labels = {*(before.labels if change.labels is None else change.labels), *change.add_labels}
    labels -= {*change.remove_labels}
    if len(labels) > MOST_LABELS:
        raise InvalidValue("labels", f"there would be {len(labels)}, more than {MOST_LABELS}.")
    after = msgspec.structs.replace(
        before,
        state=before.state if change.state is None else change.state,
        owner=before.owner if change.owner is None else change.owner,
        labels=tuple(sorted(labels)),
        ticket=before.ticket if change.ticket is None else change.ticket,
    )
    if after == before:
        return before
    return msgspec.structs.replace(after, changed_ms=at_ms, changed_by=who)


def check_change(change: TriageChange) -> TriageChange:
    """Return a change without white space around its texts.

    Raises:
        InvalidValue: a text cannot be printed or is too long, a label is empty or has a comma, or
            the ticket is no http or https address.
    """
    return msgspec.structs.replace(
        change,
        owner=None if change.owner is None else _check_text("owner", change.owner, LONGEST_OWNER),
        labels=None if change.labels is None else _check_labels("labels", change.labels),
        add_labels=_check_labels("add_labels", change.add_labels),
        remove_labels=_check_labels("remove_labels", change.remove_labels),
        ticket=None if change.ticket is None else _check_ticket(change.ticket),
    )


def check_note(text: str) -> str:
    """Return the text of a note without white space around it.

    Raises:
        InvalidValue: it is empty, too long, or has a character that cannot be printed.
    """
    lines = [line.rstrip() for line in text.replace("\t", " ").splitlines()]
    tidy = "\n".join(lines).strip()
    if not tidy or len(tidy) > LONGEST_NOTE or not tidy.replace("\n", "").isprintable():
        problem = "it is empty, too long, or contains a character that cannot be printed."
        raise InvalidValue("text", problem, f"Write up to {LONGEST_NOTE} characters.")
    return tidy


def _check_text(field: str, text: str, most: int) -> str:
    tidy = " ".join(text.split())
    if len(tidy) > most or not tidy.isprintable():
        problem = "it is too long, or contains a character that cannot be printed."
        raise InvalidValue(field, problem, f"Write up to {most} characters.")
    return tidy


def _check_labels(field: str, labels: Iterable[str]) -> tuple[str, ...]:
    tidy = tuple(_check_text(field, label, LONGEST_LABEL) for label in labels)
    for label in tidy:
        # Forms and tables write several labels with commas between them.
        if not label or "," in label:
            problem = "a label is empty, or contains a comma."
            raise InvalidValue(field, problem, "Write each label by itself.")
    return tidy


def _check_ticket(address: str) -> str:
    tidy = address.strip()
    if not tidy:
        return ""
    try:
        parts = urlsplit(tidy)
        is_address = parts.scheme in SCHEMES and bool(parts.hostname)
    except ValueError:
        is_address = False
    if not is_address or not tidy.isprintable() or " " in tidy:
        problem = f"'{tidy[:80]}' is not an address of a web page."
        raise InvalidValue("ticket", problem, "Begin it with https:// or http://.")
    return tidy
