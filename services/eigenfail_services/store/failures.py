"""The failures of all campaigns in one list, by severity, read through the index of each campaign.

No index holds the severities of all campaigns together. A page of n failures is within the n
campaigns whose first failures come first, and within the first n failures of each of them.
"""

from collections import defaultdict
from collections.abc import Iterable, Sequence
from typing import Any, NamedTuple

import sqlalchemy as sa

from eigenfail.errors import InvalidValue
from eigenfail.values.campaign import Campaign
from eigenfail.values.campaign_spec import MAX_EPISODES
from eigenfail.values.episode import Outcome
from eigenfail.values.failures import FailureFilter
from eigenfail.values.records import EpisodeRow, Page
from eigenfail_services.store.codec import to_campaign, to_row
from eigenfail_services.store.engine import StorePart
from eigenfail_services.store.episodes import ROWS
from eigenfail_services.store.listing import Expression, filter_campaigns
from eigenfail_services.store.schema import (
    campaigns,
    episode_index,
    episodes,
    requirement_values,
    spec_field,
)

MOST_FAILURES = 200
"""Most failures of a page: each campaign of a page is a part of one statement, which has limits."""

_c = episodes.c
_COLUMNS = (_c.severity, _c.campaign, episode_index)
_IS_LISTED = (_c.outcome == Outcome.COLLISION, _c.severity.is_not(None))


class _Place(NamedTuple):
    """Place of a failure in the list."""

    severity: float
    campaign: int
    episode: int

    @property
    def cursor(self) -> int:
        """Return the place as one number: no campaign has more than `MAX_EPISODES` episodes."""
        return self.campaign * MAX_EPISODES + self.episode


class _Order(NamedTuple):
    """Order of the list: severity, campaign and index, all of them descending or ascending.

    Attributes:
        descending: whether the most severe come first.
        last: the failure that the list begins after; None for its head.
    """

    descending: bool
    last: _Place | None

    def sort(self, query: sa.Select[Any], *columns: Expression) -> sa.Select[Any]:
        """Return a query in the order of some columns."""
        ordered = (column.desc() if self.descending else column for column in columns)
        return query.order_by(*ordered)

    def begin(self, query: sa.Select[Any]) -> sa.Select[Any]:
        """Return a query without the failures up to `last`."""
        if self.last is None:
            return query
        severity, campaign, index = self.last
        same = _c.severity == severity
        # The first condition alone lets the index of a campaign begin at the place.
        return query.where(
            _c.severity <= severity if self.descending else _c.severity >= severity,
            sa.or_(
                self._is_beyond(_c.severity, severity),
                sa.and_(same, self._is_beyond(_c.campaign, campaign)),
                sa.and_(same, _c.campaign == campaign, self._is_beyond(episode_index, index)),
            ),
        )

    def _is_beyond(self, column: Expression, value: float) -> Expression:
        return column < value if self.descending else column > value


class FailureStore(StorePart):
    """Collisions of all campaigns that are failures and have a severity."""

    def page(
        self,
        where: FailureFilter,
        limit: int,
        after: int | None = None,
        *,
        most_severe_first: bool = True,
    ) -> Page[EpisodeRow]:
        """Return failures by severity, and among equal ones by campaign and index.

        Args:
            where: filter of the failures.
            limit: maximum number of failures, at most `MOST_FAILURES`.
            after: only failures behind this place, the `next` of a page.
            most_severe_first: whether severity, campaign and index are all descending, or all
                ascending.

        Raises:
            InvalidValue: `after` is not the place of a failure.
        """
        with self._database.reading() as connection:
            last = None if after is None else _find_place(connection, after)
            order = _Order(most_severe_first, last)
            query = _select_of_campaigns(connection, where, order, limit + 1)
            ordered = order.sort(query, *query.selected_columns).limit(limit + 1)
            places = [_Place(*row) for row in connection.execute(ordered)]
            # One place more than the page has tells whether another page follows.
            rows = _read_rows(connection, places[:limit])
        return Page(rows, places[limit - 1].cursor if len(places) > limit else None)

    def read_campaigns(self, rows: Iterable[EpisodeRow]) -> dict[int, Campaign]:
        """Return the campaigns of failures by their ids."""
        query = sa.select(campaigns).where(campaigns.c.id.in_({row.campaign for row in rows}))
        with self._database.reading() as connection:
            return {row["id"]: to_campaign(row) for row in connection.execute(query).mappings()}


def _find_place(connection: sa.Connection, cursor: int) -> _Place:
    campaign, index = divmod(cursor, MAX_EPISODES)
    query = sa.select(*_COLUMNS).where(_c.campaign == campaign, episode_index == index, *_IS_LISTED)
    found = connection.execute(query).one_or_none()
    if found is None:
        problem = f"No failure is at the place {cursor}."
        raise InvalidValue("after", problem, "Take `next` of a page.")
    return _Place(*found)


def _filter_campaigns(where: FailureFilter) -> list[Expression]:
    """Return the conditions on the campaign of a failure."""
    found = [campaigns.c.failures > 0, *filter_campaigns(where.campaign)]
    if where.planner is not None:
        found.append(spec_field("planner") == where.planner)
    if where.besides:
        found.append(spec_field("method").not_in(where.besides))
    return found


def _select_of_campaigns(
    connection: sa.Connection, where: FailureFilter, order: _Order, most: int
) -> sa.Select[Any]:
    """Return the query for the first failures of the campaigns that may be on a page.

    No index has the severities of all campaigns. The first `most` failures of all belong to the
    `most` campaigns whose own first failures come first.
    """
    failing = order.begin(sa.select(_c.severity).where(*_IS_LISTED))
    of_campaign = failing.where(_c.campaign == campaigns.c.id).correlate(campaigns)
    first = order.sort(of_campaign, _c.severity, episode_index).limit(1).scalar_subquery()
    severity = first.label("severity")
    heads = sa.select(campaigns.c.id, severity).where(*_filter_campaigns(where))
    # Named once: SQLite would look for the first failure again for each condition on it.
    head: Expression = sa.desc(severity.name) if order.descending else sa.asc(severity.name)
    ordered = order.sort(heads.order_by(sa.nulls_last(head)), campaigns.c.id).limit(most)
    chosen = [row.id for row in connection.execute(ordered) if row.severity is not None]
    asked = failing.with_only_columns(*_COLUMNS)
    sorted_parts = (
        order.sort(asked.where(_c.campaign == each), _c.severity, episode_index) for each in chosen
    )
    parts = [each.limit(most).subquery() for each in sorted_parts]
    if not parts:
        # A union needs at least one part. This query has the same columns and no rows.
        return sa.select(*_COLUMNS).where(_c.campaign < 0)
    # SQLite accepts an order and a limit in a part of a union only if the part is a subquery.
    merged = sa.union_all(*(sa.select(*part.c) for part in parts)).subquery()
    return sa.select(*merged.c)


def _read_rows(connection: sa.Connection, places: Sequence[_Place]) -> tuple[EpisodeRow, ...]:
    """Return the failures at these places, in their order."""
    if not places:
        return ()
    keys = [(place.campaign, place.episode) for place in places]
    value = requirement_values.c
    judged: defaultdict[tuple[int, int], list[float]] = defaultdict(list)
    query = sa.select(value.campaign, value["index"], value.robustness)
    for campaign, index, robustness in connection.execute(
        query.where(_match(keys, value.campaign, value["index"])).order_by(value.requirement)
    ):
        judged[campaign, index].append(robustness)
    found = {
        (row["campaign"], row["index"]): row
        for row in connection.execute(
            ROWS.where(_match(keys, _c.campaign, episode_index))
        ).mappings()
    }
    return tuple(to_row(found[key], tuple(judged[key])) for key in keys)


def _match(keys: Sequence[tuple[int, int]], campaign: Expression, index: Expression) -> Expression:
    """Return the condition that two columns equal one of the pairs of campaign and index."""
    of_campaigns: defaultdict[int, list[int]] = defaultdict(list)
    for owner, place in keys:
        of_campaigns[owner].append(place)
    return sa.or_(*((campaign == owner) & index.in_(at) for owner, at in of_campaigns.items()))
