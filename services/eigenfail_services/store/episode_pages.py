"""How lists of episodes are asked for, page by page, whatever is wanted in whatever order."""

from collections.abc import Iterator
from typing import Any

from sqlalchemy import Connection, Select, select, tuple_

from eigenfail.filters import Conditions, Sort
from eigenfail_services.store.episode_columns import Expression, expression, fulfilled
from eigenfail_services.store.schema import episodes

number = episodes.c["index"]

INDEXED = {
    index.columns.keys()[1]
    for index in episodes.indexes
    if index.columns.keys()[::2] == ["campaign", "index"]
}
"""Columns that an index of the database sorts."""

Rows = Select[*tuple[Any, ...]]
Indices = Select[int]


def pages(
    connection: Connection, campaign: int, after: int | None, where: Conditions, sort: Sort
) -> Iterator[Indices]:
    """The questions whose answers, one after the other, are the indices behind `after`.

    Without an index of the database all of them are sorted: so they are asked for alone.
    """
    query = select(number).where(episodes.c.campaign == campaign, *fulfilled(where, sort))
    if sort.column == "index":
        yield by_index(query, after, sort)
        return
    column = expression(sort.column)
    missing = query.where(column.is_(None))
    if after is not None:
        last = select(column).where(episodes.c.campaign == campaign, number == after)
        found = connection.execute(last).one_or_none()
        if found is None:
            return
        if found[0] is None:
            yield by_index(missing, after, sort)
            return
        # Rows never change: an index stands for its place in the order.
        query = query.where(beyond(tuple_(column, number), tuple_(found[0], after), sort))
    yield by_value(query, column, sort)
    if all(condition.column != sort.column for condition in where):
        yield by_index(missing, None, sort)


def by_index(query: Indices, after: int | None, sort: Sort) -> Indices:
    """In the order of indices."""
    behind = query if after is None else query.where(beyond(number, after, sort))
    return behind.order_by(number.desc() if sort.descending else number)


def by_value(query: Indices, column: Expression, sort: Sort) -> Indices:
    """Those with a value, by it and then by index: an index of the database goes both ways."""
    order = (column.desc(), number.desc()) if sort.descending else (column, number)
    known = query.where(column.is_not(None)).order_by(*order)
    # Where all are sorted, SQLite would read them in the order of whatever index comes first.
    return known if sort.column in INDEXED else known.where(number >= 0)


def beyond(place: Any, last: Any, sort: Sort) -> Any:
    """Whether something comes behind the last one in an order."""
    return place < last if sort.descending else place > last
