"""Triage of failure modes: state, ticket and one note.

Digests do not cover triage: it is an assessment of a result, not a part of it.
"""

from enum import StrEnum
from typing import Annotated
from urllib.parse import urlsplit

import msgspec

from eigenfail.errors import InvalidValue

LONGEST_TICKET = 500
LONGEST_NOTE = 4_000

SCHEMES = ("http", "https")


class TriageState(StrEnum):
    """State of the triage of a failure mode.

    `new`: not assessed yet. `confirmed`: a fault of the planner. `known`: a fault that was found
    before. `fixed`: a fault that is gone in a later version. `not_a_bug`: needs no change.
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
    """Current triage of a failure mode.

    Attributes:
        state: state of the triage.
        ticket: address of its ticket, beginning with http:// or https://; empty without one.
        note: findings on the mode; empty without a note.
        changed_ms: time of the last change; None if it never changed. [ms since 1970]
        changed_by: name of the key of the last change; `loopback` or `network` if no key is
            required.
    """

    state: TriageState = TriageState.NEW
    ticket: str = ""
    note: str = ""
    changed_ms: int | None = None
    changed_by: str = ""


class TriageChange(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A change of triage; null leaves a field unchanged.

    Attributes:
        state: the new state.
        ticket: address of its ticket; empty for none.
        note: the new note, which replaces the old one; empty for none.
    """

    state: TriageState | None = None
    ticket: Annotated[str, msgspec.Meta(max_length=LONGEST_TICKET)] | None = None
    note: Annotated[str, msgspec.Meta(max_length=LONGEST_NOTE)] | None = None


def change_triage(before: Triage, change: TriageChange, at_ms: int, who: str) -> Triage:
    """Return the triage after a change; the same object if nothing changed."""
    after = msgspec.structs.replace(
        before,
        state=before.state if change.state is None else change.state,
        ticket=before.ticket if change.ticket is None else change.ticket,
        note=before.note if change.note is None else change.note,
    )
    if after == before:
        return before
    return msgspec.structs.replace(after, changed_ms=at_ms, changed_by=who)


def check_change(change: TriageChange) -> TriageChange:
    """Return a valid change without white space around its texts.

    Raises:
        InvalidValue: the note has a character that cannot be printed, or the ticket is not an http
            or https address.
    """
    return msgspec.structs.replace(
        change,
        ticket=None if change.ticket is None else _check_ticket(change.ticket),
        note=None if change.note is None else _check_note(change.note),
    )


def _check_note(text: str) -> str:
    lines = [line.rstrip() for line in text.replace("\t", " ").splitlines()]
    tidy = "\n".join(lines).strip()
    if not tidy.replace("\n", "").isprintable():
        problem = "it contains a character that cannot be printed."
        raise InvalidValue("note", problem, f"Write up to {LONGEST_NOTE} characters.")
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
