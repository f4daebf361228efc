"""Lists of episodes and of campaigns in SQL: what their filters and orders mean."""

from collections.abc import Iterator
from typing import Any

import msgspec
from sqlalchemy import (
    ColumnElement,
    Connection,
    Select,
    Text,
    and_,
    case,
    func,
    literal,
    null,
    or_,
    select,
    tuple_,
    type_coerce,
)

from eigenfail.errors import InvalidValue
from eigenfail.filters import (
    BY_INDEX,
    COMPARE,
    Condition,
    Conditions,
    Operator,
    SortOrder,
    Value,
    find_requirement,
)
from eigenfail.values import ConflictClass, Outcome
from eigenfail.values.campaign import CampaignFilter
from eigenfail.values.records import NEAR_MISS_TTC_S, PEAK_BRAKING_MPS2
from eigenfail_services.store.schema import (
    Number,
    PositionExpression,
    Prose,
    campaigns,
    episode_index,
    episodes,
    has_no_collision,
    mode_members,
    requirement_values,
    select_newest_analysis,
    spec_field,
    spent_usd,
)

Expression = ColumnElement[Any]

_c = episodes.c
_COLLIDED = _c.outcome == Outcome.COLLISION
_HOPELESS = or_(_c.drac_at_warning_mps2.is_(None), _c.drac_at_warning_mps2 > PEAK_BRAKING_MPS2)

_CLASS = case(
    (_c.robustness_m.is_(None), null()),
    (has_no_collision & _c.collided_s.is_not(None), null()),
    (has_no_collision & (_c.min_ttc_s < NEAR_MISS_TTC_S), ConflictClass.NEAR_MISS.value),
    (has_no_collision, ConflictClass.NONE.value),
    (_c.collided_s.is_(None), null()),
    (_COLLIDED & _HOPELESS, ConflictClass.UNAVOIDABLE.value),
    (_COLLIDED, ConflictClass.PLANNER_FAILURE.value),
)
"""As `assess` classifies episodes."""


def _select_mode() -> Expression:
    """Return the number of the mode, in the newest analysis, of the episode of an enclosing query.

    The newest is the analysis of the episode's campaign that ended with a mode and has the largest
    id. An episode that it left out has no mode, also where an older one has it.
    """
    member = mode_members.c
    newest = select_newest_analysis(_c.campaign).correlate(episodes)
    query = select(member.number).where(
        member.campaign == _c.campaign,
        member.analysis == newest.scalar_subquery(),
        member["index"] == episode_index,
    )
    return query.correlate(episodes).scalar_subquery()


_DERIVED: dict[str, Expression] = {
    "class": type_coerce(_CLASS, Text()),
    "ttc_lead_s": case((_COLLIDED, _c.collided_s - _c.ttc_violated_s)),
    "drac_lead_s": case((_COLLIDED, _c.collided_s - _c.drac_violated_s)),
    "log_probability_per_step": _c.log_probability / case((_c.steps > 0, _c.steps), else_=1),
    "mode": _select_mode(),
    "problem": type_coerce(
        _c.fault_kind + literal(": ") + func.coalesce(_c.fault_message, ""), Prose()
    ),
}
"""Columns that are computed from a row rather than stored in it."""


def select_column(column: str) -> Expression:
    """Return a column of the list of episodes as an SQL expression."""
    if (number := find_requirement(column)) is not None:
        return _select_requirement(number)
    return _DERIVED[column] if column in _DERIVED else _c[column]


def _select_requirement(number: int) -> Expression:
    """Return the robustness of a requirement, of the episode of an enclosing query."""
    value = requirement_values.c
    query = select(value.robustness).where(
        value.campaign == episodes.c.campaign,
        value["index"] == episode_index,
        value.requirement == number,
    )
    return query.correlate(episodes).scalar_subquery()


def _compare_episodes(where: Conditions, sort: SortOrder) -> Iterator[Expression]:
    """Yield the conditions so that the database follows the order, not one of the conditions."""
    for condition in where:
        column = select_column(condition.column)
        leads = _has_index(condition, sort)
        # SQLite, which knows nothing of how many rows match, would take any index for a condition
        # and then sort what it found, for every page anew.
        compared = column if leads else func.coalesce(column, null(), type_=column.type)
        yield COMPARE[condition.operator](compared, _bind(condition.value))


def _bind(value: Value) -> Any:
    """Return a value to compare with; a whole number may exceed the range of its column."""
    return literal(value, Number()) if type(value) is int else value


def _has_index(condition: Condition, sort: SortOrder) -> bool:
    """Return whether an index holds the rows of a condition in the wanted order."""
    if condition.column == sort.column:
        return True
    # Violations are few, or all that there is: they are sorted, and not looked for row by row.
    of_one_outcome = condition.column == "outcome" and condition.operator is Operator.EQUAL
    return sort.column == "index" and (of_one_outcome or condition.column == "violated")


INDEXED = {
    index.columns.keys()[1]
    for index in episodes.indexes
    if index.columns.keys()[::2] == ["campaign", "index"]
}
"""Columns that an index of the database sorts."""

_Indices = Select[int]


def page_queries(
    connection: Connection, campaign: int, after: int | None, where: Conditions, sort: SortOrder
) -> Iterator[_Indices]:
    """Yield the queries whose answers, one after the other, are the indices behind `after`.

    They select indices only: without an index of the database all rows are sorted.
    """
    query = select(episode_index).where(
        episodes.c.campaign == campaign, *_compare_episodes(where, sort)
    )
    if sort.column == "index":
        yield _by_index(query, after, sort)
        return
    column = select_column(sort.column)
    missing = query.where(column.is_(None))
    if after is not None:
        last = select(column).where(episodes.c.campaign == campaign, episode_index == after)
        found = connection.execute(last).one_or_none()
        if found is None:
            return
        if found[0] is None:
            yield _by_index(missing, after, sort)
            return
        # Rows never change: an index stands for its place in the order.
        query = query.where(_beyond(tuple_(column, episode_index), tuple_(found[0], after), sort))
    yield _by_value(query, column, sort)
    if all(condition.column != sort.column for condition in where):
        yield _by_index(missing, None, sort)


def preceding_queries(
    connection: Connection, campaign: int, before: int, where: Conditions, sort: SortOrder
) -> Iterator[_Indices]:
    """Yield the queries whose answers, one after the other, are the indices in front of `before`.

    The nearest comes first. It is not the opposite order, in which rows without a value are last
    as well.
    """
    query = select(episode_index).where(
        episodes.c.campaign == campaign, *_compare_episodes(where, sort)
    )
    turned = SortOrder(sort.column, not sort.descending)
    if sort.column == "index":
        yield _by_index(query, before, turned)
        return
    column = select_column(sort.column)
    own = select(column).where(episodes.c.campaign == campaign, episode_index == before)
    found = connection.execute(own).one_or_none()
    if found is None:
        return
    if found[0] is None:
        yield _by_index(query.where(column.is_(None)), before, turned)
        yield _by_value(query, column, turned)
        return
    place = tuple_(column, episode_index), tuple_(found[0], before)
    yield _by_value(query.where(_beyond(*place, turned)), column, turned)


def count_episodes(campaign: int, where: Conditions) -> Select[int]:
    """Return the query of the number of episodes that fulfil all conditions."""
    matching = _compare_episodes(where, BY_INDEX)
    return select(func.count()).where(episodes.c.campaign == campaign, *matching)


def _by_index(query: _Indices, after: int | None, sort: SortOrder) -> _Indices:
    behind = query if after is None else query.where(_beyond(episode_index, after, sort))
    return behind.order_by(episode_index.desc() if sort.descending else episode_index)


def _by_value(query: _Indices, column: Expression, sort: SortOrder) -> _Indices:
    """Select rows that have a value, by value and index: an index can be read both ways."""
    order = (column.desc(), episode_index.desc()) if sort.descending else (column, episode_index)
    known = query.where(column.is_not(None)).order_by(*order)
    # Where all are sorted, SQLite would read them in the order of whatever index comes first.
    return known if sort.column in INDEXED else known.where(episode_index >= 0)


def _beyond(place: Any, last: Any, sort: SortOrder) -> Any:
    return place < last if sort.descending else place > last


_SORTED: dict[str, ColumnElement[Any]] = {
    **{name: campaigns.c[name] for name in ("id", "state", "failures", "completed")},
    **{name: func.lower(spec_field(name)) for name in ("name", "planner", "method")},
    "cost_per_failure_usd": case((campaigns.c.failures > 0, spent_usd / campaigns.c.failures)),
}
"""Expressions by the names of orders."""


def sort_campaigns(
    connection: Connection, query: Select[Any], before: int | None, sort: SortOrder
) -> Select[Any]:
    """Return the query in an order, behind the campaign `before` in it.

    Raises:
        InvalidValue: the order is not by id, and no campaign has the id `before`.
    """
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
    found = connection.execute(select(value).where(number == before)).one_or_none()
    if found is None:
        raise InvalidValue("before", f"Campaign {before} does not exist.", "Take `next` of a page.")
    last = found[0]
    if last is None:
        return ordered.where(value.is_(None), number < before)
    farther = value < last if sort.descending else value > last
    return ordered.where(or_(farther, and_(value == last, number < before), value.is_(None)))


def filter_campaigns(where: CampaignFilter) -> Iterator[ColumnElement[bool]]:
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


def contains_text(column: ColumnElement[Any], text: str) -> ColumnElement[bool]:
    """Return the condition that a column contains a text, in small or large letters."""
    words = text.lower().replace("\x00", "�")  # which no database takes
    return func.lower(column).contains(words, autoescape=True)


def _filter_labels(where: CampaignFilter) -> Iterator[ColumnElement[bool]]:
    if where.project is not None:
        yield campaigns.c.project == where.project
    if where.planner_version is not None:
        yield campaigns.c.planner_version == where.planner_version
    if where.tag is not None:
        # Tags hold no quotation marks, so that only whole tags are found.
        quoted = msgspec.json.encode(where.tag).decode()
        yield PositionExpression(campaigns.c.tags, literal(quoted, Prose())) > 0
