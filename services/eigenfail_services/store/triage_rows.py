"""Rows of triage: how they are read, and what conditions on them mean in SQL."""

from collections.abc import Sequence
from enum import StrEnum

from sqlalchemy import ColumnElement, Connection, RowMapping, func, select

from eigenfail.filters import Condition, Operator
from eigenfail.values.triage import UNTOUCHED, Triage, TriageState
from eigenfail_services.store.engine import chunks
from eigenfail_services.store.schema import episode_index, episodes, triage


class TriageKind(StrEnum):
    """What a row of triage belongs to."""

    MODE = "mode"
    EPISODE = "episode"


TRIAGE_COLUMNS = {"state": UNTOUCHED.state.value, "owner": UNTOUCHED.owner, "label": ""}
"""Columns of episodes that are kept apart from them, with their values without a row."""

BRIEF_TRIAGE = (triage.c.state, triage.c.owner, triage.c.labels)

_BREAK = "\n"


def join_labels(labels: Sequence[str]) -> str:
    """Return labels in their stored form: each between two newlines; empty without a label."""
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


def is_triaged(campaign: int, condition: Condition) -> ColumnElement[bool]:
    """Return a condition on a column of `TRIAGE_COLUMNS`, of the episode of an enclosing query.

    An episode without a row has the usual value: it is not among those with another one.

    Args:
        campaign: id of the campaign whose episodes the query selects.
        condition: the condition.
    """
    name, is_equal = condition.column, condition.operator is Operator.EQUAL
    column = triage.c["labels" if name == "label" else name]
    if condition.value == TRIAGE_COLUMNS[name]:
        chosen, is_among = column != condition.value, not is_equal
    elif name == "label":
        chosen, is_among = _holds_label(str(condition.value)), is_equal
    else:
        chosen, is_among = column == condition.value, is_equal
    ours = (triage.c.kind == TriageKind.EPISODE) & (triage.c.parent == campaign) & chosen
    return _is_among(ours) if is_among else _is_not_among(ours)


def _holds_label(label: str) -> ColumnElement[bool]:
    # LIKE would take small letters for large ones in one of the databases.
    return func.replace(triage.c.labels, join_labels((label,)), "") != triage.c.labels


def _is_among(ours: ColumnElement[bool]) -> ColumnElement[bool]:
    # Read once for a query: triaged episodes are few beside those of the campaign.
    return episode_index.in_(select(triage.c.number).where(ours))


def _is_not_among(ours: ColumnElement[bool]) -> ColumnElement[bool]:
    # By the primary key, for each row: SQLite would scan a list of numbers for NOT IN.
    same = triage.c.number == episode_index
    return ~select(triage.c.kind).where(ours, same).correlate(episodes).exists()
