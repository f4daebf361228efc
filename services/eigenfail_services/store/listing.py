"""Lists of episodes and of campaigns in SQL: what their filters and orders mean."""

from collections.abc import Callable, Iterator
from typing import Any, TypeVar

import msgspec
import sqlalchemy as sa

from eigenfail import filters
from eigenfail.errors import InvalidValue
from eigenfail.values.campaign import CampaignFilter
from eigenfail.values.episode import Outcome
from eigenfail.values.records import NEAR_MISS_TTC_S, ConflictClass, Page
from eigenfail_services.store.schema import (
    Number,
    PositionExpression,
    Prose,
    campaigns,
    episode_index,
    episodes,
    has_no_collision,
    is_hopeless,
    mode_members,
    requirement_values,
    select_newest_analysis,
    spec_field,
    spent_usd,
)

Expression = sa.ColumnElement[Any]

_c = episodes.c
_COLLIDED = _c.outcome == Outcome.COLLISION

_CLASS = sa.case(
    (_c.robustness_m.is_(None), sa.null()),
    (has_no_collision & _c.collided_s.is_not(None), sa.null()),
    (has_no_collision & (_c.min_ttc_s < NEAR_MISS_TTC_S), ConflictClass.NEAR_MISS.value),
    (has_no_collision, ConflictClass.NONE.value),
    (_c.collided_s.is_(None), sa.null()),
    (_COLLIDED & is_hopeless, ConflictClass.UNAVOIDABLE.value),
    (_COLLIDED, ConflictClass.PLANNER_FAILURE.value),
)
"""Conflict class of an episode as an SQL expression, with the classes of `assess`."""


def _select_mode() -> Expression:
    """Return the number of the mode, in the newest analysis, of the episode of an enclosing query.

    The newest is the analysis of the episode's campaign that ended with a mode and has the largest
    id. An episode that this analysis left out is without a mode, even if an older analysis has it.
    """
    member = mode_members.c
    newest = select_newest_analysis(_c.campaign).correlate(episodes)
    query = sa.select(member.number).where(
        member.campaign == _c.campaign,
        member.analysis == newest.scalar_subquery(),
        member["index"] == episode_index,
    )
    return query.correlate(episodes).scalar_subquery()


_DERIVED: dict[str, Expression] = {
    "class": sa.type_coerce(_CLASS, sa.Text()),
    "ttc_lead_s": sa.case((_COLLIDED, _c.collided_s - _c.ttc_violated_s)),
    "drac_lead_s": sa.case((_COLLIDED, _c.collided_s - _c.drac_violated_s)),
    "log_probability_per_step": _c.log_probability / sa.case((_c.steps > 0, _c.steps), else_=1),
    "mode": _select_mode(),
    "problem": sa.type_coerce(
        _c.fault_kind + sa.literal(": ") + sa.func.coalesce(_c.fault_message, ""), Prose()
    ),
}
"""Columns that are computed from a row rather than stored in it."""


def select_column(column: str) -> Expression:
    """Return a column of the list of episodes as an SQL expression."""
    if (number := filters.find_requirement(column)) is not None:
        return _select_requirement(number)
    return _DERIVED[column] if column in _DERIVED else _c[column]


def _select_requirement(number: int) -> Expression:
    """Return the robustness of a requirement, of the episode of an enclosing query."""
    value = requirement_values.c
    query = sa.select(value.robustness).where(
        value.campaign == episodes.c.campaign,
        value["index"] == episode_index,
        value.requirement == number,
    )
    return query.correlate(episodes).scalar_subquery()


def _compare_episodes(where: filters.Conditions, sort: filters.SortOrder) -> Iterator[Expression]:
    """Yield the conditions in a form that makes the database follow the order, not a condition."""
    for condition in where:
        column = select_column(condition.column)
        leads = _has_index(condition, sort)
        # SQLite, which knows nothing of how many rows match, would take any index for a condition
        # and then sort what it found, for every page anew.
        compared = column if leads else sa.func.coalesce(column, sa.null(), type_=column.type)
        yield filters.COMPARE[condition.operator](compared, _bind(condition.value))


def _bind(value: filters.Value) -> Any:
    """Return a value to compare with; a whole number may exceed the range of its column."""
    return sa.literal(value, Number()) if type(value) is int else value


def _has_index(condition: filters.Condition, sort: filters.SortOrder) -> bool:
    """Return whether an index holds the rows of a condition in the wanted order."""
    if condition.column == sort.column:
        return True
    # Violations are few, or all that there is: they are sorted, and not looked for row by row.
    of_one_outcome = condition.column == "outcome" and condition.operator is filters.Operator.EQUAL
    return sort.column == "index" and (of_one_outcome or condition.column == "violated")


INDEXED = {
    index.columns.keys()[1]
    for index in episodes.indexes
    if index.columns.keys()[::2] == ["campaign", "index"]
}
"""Columns that an index of the database sorts."""

_Indices = sa.Select[int]


def page_queries(
    connection: sa.Connection,
    campaign: int,
    after: int | None,
    where: filters.Conditions,
    sort: filters.SortOrder,
) -> Iterator[_Indices]:
    """Yield the queries whose answers, in sequence, are the indices behind `after`.

    They select indices only: without an index of the database all rows are sorted.
    """
    query = sa.select(episode_index).where(
        episodes.c.campaign == campaign, *_compare_episodes(where, sort)
    )
    if sort.column == "index":
        yield _by_index(query, after, sort)
        return
    column = select_column(sort.column)
    missing = query.where(column.is_(None))
    if after is not None:
        last = sa.select(column).where(episodes.c.campaign == campaign, episode_index == after)
        found = connection.execute(last).one_or_none()
        if found is None:
            return
        if found[0] is None:
            yield _by_index(missing, after, sort)
            return
        # Rows never change: an index stands for its place in the order.
        query = query.where(
            _beyond(sa.tuple_(column, episode_index), sa.tuple_(found[0], after), sort)
        )
    yield _by_value(query, column, sort)
    if all(condition.column != sort.column for condition in where):
        yield _by_index(missing, None, sort)


def preceding_queries(
    connection: sa.Connection,
    campaign: int,
    before: int,
    where: filters.Conditions,
    sort: filters.SortOrder,
) -> Iterator[_Indices]:
    """Yield the queries whose answers, in sequence, are the indices in front of `before`.

    The nearest comes first. This is not the opposite order, which also puts rows without a value
    last.
    """
    query = sa.select(episode_index).where(
        episodes.c.campaign == campaign, *_compare_episodes(where, sort)
    )
    turned = filters.SortOrder(sort.column, not sort.descending)
    if sort.column == "index":
        yield _by_index(query, before, turned)
        return
    column = select_column(sort.column)
    own = sa.select(column).where(episodes.c.campaign == campaign, episode_index == before)
    found = connection.execute(own).one_or_none()
    if found is None:
        return
    if found[0] is None:
        yield _by_index(query.where(column.is_(None)), before, turned)
        yield _by_value(query, column, turned)
        return
    place = sa.tuple_(column, episode_index), sa.tuple_(found[0], before)
    yield _by_value(query.where(_beyond(*place, turned)), column, turned)


def count_episodes(campaign: int, where: filters.Conditions) -> sa.Select[int]:
    """Return the query of the number of episodes that fulfil all conditions."""
    matching = _compare_episodes(where, filters.BY_INDEX)
    return sa.select(sa.func.count()).where(episodes.c.campaign == campaign, *matching)


def _by_index(query: _Indices, after: int | None, sort: filters.SortOrder) -> _Indices:
    behind = query if after is None else query.where(_beyond(episode_index, after, sort))
    return behind.order_by(episode_index.desc() if sort.descending else episode_index)


def _by_value(query: _Indices, column: Expression, sort: filters.SortOrder) -> _Indices:
    """Select rows that have a value, by value and index: an index can be read both ways."""
    order = (column.desc(), episode_index.desc()) if sort.descending else (column, episode_index)
    known = query.where(column.is_not(None)).order_by(*order)
    # Where all are sorted, SQLite would read them in the order of whatever index comes first.
    return known if sort.column in INDEXED else known.where(episode_index >= 0)


def _beyond(place: Any, last: Any, sort: filters.SortOrder) -> Any:
    return place < last if sort.descending else place > last


_SORTED: dict[str, sa.ColumnElement[Any]] = {
    **{name: campaigns.c[name] for name in ("id", "state", "failures", "completed")},
    **{name: sa.func.lower(spec_field(name)) for name in ("name", "planner", "method")},
    "cost_per_failure_usd": sa.case((campaigns.c.failures > 0, spent_usd / campaigns.c.failures)),
}
"""Expressions by the names of orders."""


Item = TypeVar("Item")


def iterate_items(read: Callable[[int | None], Page[Item]]) -> Iterator[Item]:
    """Yield the items of all pages of a list; `read` returns the page behind a cursor."""
    page = read(None)
    yield from page.items
    while page.next is not None:
        page = read(page.next)
        yield from page.items


def sort_campaigns(
    connection: sa.Connection, query: sa.Select[Any], before: int | None, sort: filters.SortOrder
) -> sa.Select[Any]:
    """Return the query in an order, behind the campaign `before` in it.

    Raises:
        InvalidValue: the order is not by id, and no campaign has the id `before`.
    """
    # Ids break ties in every order, so that no campaign is on two pages or on none.
    value, number = _SORTED[sort.column], campaigns.c.id
    if sort.column == "id":  # in the order of the table: nothing is sorted
        ordered = query.order_by(number.desc() if sort.descending else number)
        if before is None:
            return ordered
        return ordered.where(number < before if sort.descending else number > before)
    ordered = query.order_by(
        value.is_(None), value.desc() if sort.descending else value, number.desc()
    )
    if before is None:
        return ordered
    found = connection.execute(sa.select(value).where(number == before)).one_or_none()
    if found is None:
        raise InvalidValue("before", f"Campaign {before} does not exist.", "Take `next` of a page.")
    last = found[0]
    if last is None:
        return ordered.where(value.is_(None), number < before)
    farther = value < last if sort.descending else value > last
    return ordered.where(sa.or_(farther, sa.and_(value == last, number < before), value.is_(None)))


def filter_campaigns(where: CampaignFilter) -> Iterator[sa.ColumnElement[bool]]:
    """Yield the conditions of a filter."""
    yield from _filter_labels(where)
    if where.method is not None:
        yield spec_field("method") == where.method
    if where.besides is not None:
        yield spec_field("method") != where.besides
    if where.state is not None:
        yield campaigns.c.state == where.state
    if where.suite is not None:
        yield campaigns.c.suite == where.suite
    if where.archived is not None:
        archived_ms = campaigns.c.archived_ms
        yield archived_ms.is_not(None) if where.archived else archived_ms.is_(None)
    if where.search is not None:
        yield contains_text(spec_field("name"), where.search)


def contains_text(column: sa.ColumnElement[Any], text: str) -> sa.ColumnElement[bool]:
    """Return the condition that a column contains a text, in small or large letters."""
    words = text.lower().replace("\x00", "�")  # which no database takes
    return sa.func.lower(column).contains(words, autoescape=True)


def _filter_labels(where: CampaignFilter) -> Iterator[sa.ColumnElement[bool]]:
    if where.project is not None:
        yield campaigns.c.project == where.project
    if where.planner_version is not None:
        yield campaigns.c.planner_version == where.planner_version
    if where.tag is not None:
        # Tags hold no quotation marks, so that only whole tags are found.
        quoted = msgspec.json.encode(where.tag).decode()
        yield PositionExpression(campaigns.c.tags, sa.literal(quoted, Prose())) > 0
