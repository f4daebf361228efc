"""Rows of triage: how they are read, and what conditions on them mean in SQL."""

from collections.abc import Sequence
from enum import StrEnum
from typing import Any

from sqlalchemy import ColumnElement, Connection, RowMapping, func, select, tuple_

from eigenfail.filters import Condition, Operator
from eigenfail.values.triage import UNTOUCHED, Triage, TriageState
from eigenfail_services.store.engine import chunks
from eigenfail_services.store.schema import episode_index, episodes, triage


class TriageKind(StrEnum):
    """What a row of triage belongs to."""

    MODE = "mode"
    EPISODE = "episode"


TRIAGE_COLUMNS = {"state": UNTOUCHED.state.value, "owner": UNTOUCHED.owner, "label": None}
"""Columns of episodes that are kept apart from them, with their values without a row."""

BRIEF_TRIAGE = (triage.c.state, triage.c.owner, triage.c.labels)

_BREAK = "\n"


def join_labels(labels: Sequence[str]) -> str:
    """Return labels as they are stored: each between two newlines, or nothing without any."""
    return _BREAK.join(("", *labels, "")) if labels else ""


def split_labels(stored: str) -> tuple[str, ...]:
    """Return the labels of a stored text."""
    return tuple(stored.strip(_BREAK).split(_BREAK)) if stored else ()


def to_brief_triage(
    state: str | None, owner: str | None, labels: str | None
) -> tuple[TriageState, str, tuple[str, ...]]:
    """Return state, owner and labels from their columns, which are None without a row."""
    known = UNTOUCHED.state if state is None else TriageState(state)
    return known, owner or "", split_labels(labels or "")


def to_triage(found: RowMapping) -> Triage:
    """Return triage from its row."""
    state, owner, labels = to_brief_triage(found["state"], found["owner"], found["labels"])
    return Triage(
        *(state, owner, labels, found["ticket"]), found["changed_ms"], found["changed_by"]
    )


def read_triage(
    connection: Connection, kind: TriageKind, parent: int, numbers: Sequence[int]
) -> dict[int, Triage]:
    """Return the triage of those modes or episodes that have a row, by number."""
    ours = select(triage).where(triage.c.kind == kind, triage.c.parent == parent)
    return {
        row["number"]: to_triage(row)
        for chunk in chunks(numbers)
        for row in connection.execute(ours.where(triage.c.number.in_(chunk))).mappings()
    }


def is_triaged(condition: Condition) -> ColumnElement[bool]:
    """Return a condition on a column of `TRIAGE_COLUMNS`, of the episode of an enclosing query."""
    is_so = _has_triage(condition.column, condition.value)
    return is_so if condition.operator is Operator.EQUAL else ~is_so


def _has_triage(column: str, value: Any) -> ColumnElement[bool]:
    """Return whether the triage of an episode has a value, or a label.

    An episode without a row has the usual value: it is not among those with another one.
    """
    if column == "label":
        return _is_among(_holds_label(str(value)))
    if value == TRIAGE_COLUMNS[column]:
        return ~_is_among(triage.c[column] != value)
    return _is_among(triage.c[column] == value)


def _holds_label(label: str) -> ColumnElement[bool]:
    # LIKE would take small letters for large ones in one of the databases.
    return func.replace(triage.c.labels, join_labels((label,)), "") != triage.c.labels


def _is_among(chosen: ColumnElement[bool]) -> ColumnElement[bool]:
    # Read once for a query: triaged episodes are few beside those of the campaign.
    rows = select(triage.c.parent, triage.c.number).where(
        triage.c.kind == TriageKind.EPISODE, chosen
    )
    return tuple_(episodes.c.campaign, episode_index).in_(rows)
