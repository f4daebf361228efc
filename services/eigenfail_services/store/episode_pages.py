"""How lists of episodes are asked for, page by page."""

from collections.abc import Callable
from typing import Any

from sqlalchemy import ColumnElement, Select, and_, func, or_, select

from eigenfail.values import Outcome
from eigenfail.values.records import EpisodeOrder
from eigenfail_services.store.schema import episodes

number = episodes.c["index"]
NO_SEVERITY = -1.0
"""Behind every collision."""

Rows = Select[*tuple[Any, ...]]


def rows(campaign: int, after: int | None, outcome: Outcome | None, order: EpisodeOrder) -> Rows:
    """The episodes behind `after` in an order."""
    query = select(episodes).where(episodes.c.campaign == campaign)
    if outcome is not None:
        query = query.where(episodes.c.outcome == outcome)
    return ORDERS[order](query, campaign, after)


def by_index(query: Rows, _campaign: int, after: int | None) -> Rows:
    """In index order."""
    behind = query if after is None else query.where(number > after)
    return behind.order_by(number)


def by_severity(query: Rows, campaign: int, after: int | None) -> Rows:
    """Worst first; as rows never change, an index stands for its place in the order."""
    severity = func.coalesce(episodes.c.severity, NO_SEVERITY)
    if after is not None:
        last = severity_of(campaign, after)
        query = query.where(or_(severity < last, and_(severity == last, number > after)))
    return query.order_by(severity.desc(), number)


def severity_of(campaign: int, index: int) -> ColumnElement[float]:
    """The severity of an episode, as a part of a question."""
    other = episodes.alias()
    found = select(other.c.severity).where(other.c.campaign == campaign, other.c["index"] == index)
    return func.coalesce(found.scalar_subquery(), NO_SEVERITY)


ORDERS: dict[EpisodeOrder, Callable[[Rows, int, int | None], Rows]] = {
    EpisodeOrder.INDEX: by_index,
    EpisodeOrder.SEVERITY: by_severity,
}
