"""Episodes: lists of them by filter and order, and the one result that each may have.

Results enter the database by a fixed number of statements, however many there are.
"""

from collections import defaultdict
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import lru_cache
from typing import Any

import sqlalchemy as sa
from msgspec.structs import replace
from sqlalchemy.dialects import sqlite
from sqlalchemy.dialects.postgresql import psycopg

from eigenfail import filters
from eigenfail.values import records
from eigenfail.values.comparison import PairTotals
from eigenfail.values.episode import EpisodeResult, Outcome
from eigenfail.values.records import Page
from eigenfail.values.safety import SeveritySample
from eigenfail_services.store import campaign_rows, codec, listing, schema, totals
from eigenfail_services.store.clock import now_ms
from eigenfail_services.store.engine import StorePart, chunks
from eigenfail_services.store.errors import make_episode_error, make_pruned_error
from eigenfail_services.store.events import append_event
from eigenfail_services.store.judging import Kept, judge, make_rows
from eigenfail_services.store.retention import select_pruned_ms

ROWS_AT_A_TIME = 5_000

SCENES_AT_A_TIME = 100
"""Scenes that are in memory together: one of a long episode with many vehicles has 100 kB."""

_KNOWN = sa.select(schema.episode_index, schema.episodes.c.digest).where(
    schema.episodes.c.campaign == sa.bindparam("campaign"),
    # Of the plain type: there are none outside the campaign's range, which `Number` would clamp.
    schema.episode_index.in_(sa.bindparam("indices", type_=sa.BigInteger(), expanding=True)),
)

_POSITIONAL = {
    "sqlite": sqlite.dialect(paramstyle="qmark"),
    "postgresql": psycopg.dialect(paramstyle="format"),  # type: ignore[no-untyped-call]
}
"""Dialects whose placeholders have no names, so that rows are tuples and need no keys."""


def _store_deliveries(
    connection: sa.Connection, campaign: int, deliveries: Sequence[records.Delivery]
) -> list[records.Verdict]:
    """Store results, update the counts, and log alarms; return one verdict for each delivery.

    Raises:
        NotFound: no such campaign.
    """
    before = campaign_rows.lock_campaign(connection, campaign)
    indices = {delivery.result.index for delivery in deliveries}
    known = _read_digests(
        connection, campaign, {index for index in indices if 0 <= index < before.counts.planned}
    )
    judgement = judge(before, known, deliveries)
    _insert_results(connection, campaign, judgement.kept)
    if judgement.counts != before.counts:
        campaign_rows.update_counts(connection, campaign, judgement.counts)
    for alarm in judgement.alarms:
        message = (
            f"Worker {alarm.worker} brought another result of episode {alarm.result.index} of "
            f"campaign {campaign} than the one that is kept: simulator, planner or machine is not "
            "deterministic."
        )
        append_event(connection, "episode.alarm", message, campaign)
    return judgement.verdicts


def _read_digests(connection: sa.Connection, campaign: int, indices: set[int]) -> dict[int, str]:
    return {
        index: known
        for chunk in chunks(indices)
        for index, known in connection.execute(_KNOWN, {"campaign": campaign, "indices": chunk})
    }


def _insert_results(connection: sa.Connection, campaign: int, kept: Sequence[Kept]) -> None:
    if not kept:
        return
    at_ms = now_ms()
    # Episodes are inserted first: the rows of the other tables refer to them.
    _insert_rows(connection, schema.episodes, make_rows(campaign, kept, at_ms))
    _insert_rows(connection, schema.trajectories, [_blobs(campaign, one.result) for one in kept])
    seen = [
        (campaign, one.result.index, codec.pack(one.result.scene))
        for one in kept
        if one.result.scene is not None
    ]
    if seen:
        _insert_rows(connection, schema.scenes, seen)
    judged = [
        (campaign, one.result.index, number, value)
        for one in kept
        for number, value in enumerate(one.result.requirements, start=1)
        if value is not None
    ]
    if judged:
        _insert_rows(connection, schema.requirement_values, judged)


def _blobs(campaign: int, result: EpisodeResult) -> tuple[object, ...]:
    return (
        campaign,
        result.index,
        codec.to_blob(result.noise.z),
        codec.to_blob(result.noise.sigma),
        None if result.states is None else codec.to_blob(result.states),
        None if result.importance is None else codec.to_blob(result.importance),
    )


def _insert_rows(connection: sa.Connection, table: sa.Table, rows: list[tuple[Any, ...]]) -> None:
    """Insert whole rows, each in the order of the table's columns.

    Columns without any value are left out of the statement. To bind a None, the driver of SQLite
    looks for an adapter first, which takes longer than to bind a number.
    """
    columns = zip(table.columns.keys(), zip(*rows, strict=True), strict=True)
    filled = {name: values for name, values in columns if values.count(None) < len(rows)}
    # For each row, SQLAlchemy's own way takes as long as SQLite needs to insert it.
    statement = _compile_insert(table, tuple(filled), connection.dialect.name)
    connection.exec_driver_sql(statement, [*zip(*filled.values(), strict=True)])


@lru_cache(maxsize=64)
def _compile_insert(table: sa.Table, columns: tuple[str, ...], dialect: str) -> str:
    """Return the statement that inserts a row, with a placeholder for each of the columns."""
    inserted = sa.insert(table).values({name: sa.bindparam(name) for name in columns})
    return str(inserted.compile(dialect=_POSITIONAL[dialect]))


def _add_death(connection: sa.Connection, campaign: int, index: int) -> int:
    # No upsert is needed: the campaign is locked, so no other transaction inserts the row between
    # these two statements.
    count = (
        sa.update(schema.deaths)
        .where(schema.deaths.c.campaign == campaign, schema.deaths.c["index"] == index)
        .values(workers=schema.deaths.c.workers + 1)
        .returning(schema.deaths.c.workers)
    )
    if (workers := connection.execute(count).scalar_one_or_none()) is not None:
        return int(workers)
    connection.execute(sa.insert(schema.deaths).values(campaign=campaign, index=index, workers=1))
    return 1


_SAME_TRAJECTORY = (schema.trajectories.c.campaign == schema.episodes.c.campaign) & (
    schema.trajectories.c["index"] == schema.episode_index
)
_SAME_SCENE = (schema.scenes.c.campaign == schema.episodes.c.campaign) & (
    schema.scenes.c["index"] == schema.episode_index
)
_RESULTS = (
    sa.select(*schema.episodes.c, schema.campaigns.c.spec)
    .add_columns(schema.trajectories.c.z, schema.trajectories.c.sigma, schema.trajectories.c.states)
    .add_columns(schema.trajectories.c.importance)
    .select_from(schema.episodes)
    .join(schema.campaigns, schema.campaigns.c.id == schema.episodes.c.campaign)
    .outerjoin(schema.trajectories, _SAME_TRAJECTORY)
    .add_columns(select_pruned_ms().label("pruned_ms"))
)

ROWS = sa.select(
    *schema.episodes.c,
    select_pruned_ms().label("noise_pruned_ms"),
    listing.select_column("mode").label("mode"),
)
"""Columns of the lines of a list of episodes."""

_SPEC = sa.select(schema.campaigns.c.spec).where(schema.campaigns.c.id == sa.bindparam("campaign"))


class EpisodeStore(StorePart):
    """Results of episodes: at most one for each, which never changes."""

    def commit(
        self,
        campaign: int,
        deliveries: Sequence[records.Delivery],
        meanwhile: Callable[[], None] = lambda: None,
    ) -> list[records.Verdict]:
        """Store results, update counts, and log alarms; return one verdict for each delivery.

        Args:
            campaign: id of the campaign.
            deliveries: the delivered results.
            meanwhile: runs again and again while the transaction is committed; it must not use
                the store.
        """
        with self._database.writing(self._database.commit_beside(meanwhile)) as connection:
            return _store_deliveries(connection, campaign, deliveries)

    def add_death(self, campaign: int, index: int) -> int:
        """Count one more worker that was lost while it ran an episode; return how many were.

        Raises:
            NotFound: no such campaign.
        """
        with self._database.writing() as connection:
            campaign_rows.lock_campaign(connection, campaign)
            return _add_death(connection, campaign, index)

    def get(self, campaign: int, index: int) -> EpisodeResult:
        """Return the result of an episode with everything that is stored of it.

        Raises:
            NotFound: the campaign, or the result of the episode, does not exist.
            NoisePruned: the episode's noise was pruned.
        """
        query = (
            _RESULTS.add_columns(schema.scenes.c.scene)
            .outerjoin(schema.scenes, _SAME_SCENE)
            .where(schema.episodes.c.campaign == campaign, schema.episode_index == index)
        )
        with self._database.reading() as connection:
            campaign_rows.read_campaign(connection, campaign)
            found = connection.execute(query).mappings().one_or_none()
            judged = _read_requirements(connection, campaign, [index])[index]
        if found is None or not _has_result(found):
            raise make_episode_error(campaign, index)
        return replace(codec.to_result(found, found["scene"]), requirements=tuple(judged))

    def page(
        self,
        campaign: int,
        limit: int,
        after: int | None = None,
        where: filters.Conditions = (),
        sort: filters.SortOrder = filters.BY_INDEX,
    ) -> Page[records.EpisodeRow]:
        """Return episodes that fulfil all conditions, in an order, behind the index `after` in it.

        By index, `after` may be any number. In another order it must be the index of an episode
        with a result. Pages then follow each other without gap or overlap, whatever is added.
        """
        found: list[records.EpisodeRow] = []
        with self._database.reading() as connection:
            for query in listing.page_queries(connection, campaign, after, where, sort):
                keys = query.limit(limit + 1 - len(found))
                found += _rows(connection, campaign, connection.execute(keys).scalars().all())
                if len(found) > limit:
                    break
        items = tuple(found[:limit])
        return Page(items, items[-1].index if len(found) > limit else None)

    def iterate(self, campaign: int) -> Iterator[records.EpisodeRow]:
        """Yield the finished episodes of a campaign by index; no transaction stays open."""
        return listing.iterate_items(lambda after: self.page(campaign, ROWS_AT_A_TIME, after))

    def count(self, campaign: int, where: filters.Conditions = ()) -> int:
        """Return the number of finished episodes that fulfil all conditions."""
        with self._database.reading() as connection:
            return connection.execute(listing.count_episodes(campaign, where)).scalar_one()

    def find_preceding(
        self,
        campaign: int,
        before: int,
        where: filters.Conditions = (),
        sort: filters.SortOrder = filters.BY_INDEX,
    ) -> int | None:
        """Return the index in front of an episode in a list as `page` returns it; None at its head.

        Args:
            campaign: id of the campaign.
            before: index of the episode, which has a result.
            where: conditions of the list.
            sort: order of the list.
        """
        with self._database.reading() as connection:
            for query in listing.preceding_queries(connection, campaign, before, where, sort):
                if (found := connection.execute(query.limit(1)).scalar()) is not None:
                    return int(found)
        return None

    def list_mode_failures(
        self, analysis: int, number: int, sort: filters.SortOrder, limit: int
    ) -> list[records.EpisodeRow]:
        """Return the first failures of a mode in an order; its campaigns may be several."""
        column = listing.select_column(sort.column)
        last_first = column.desc() if sort.descending else column
        query = (
            sa.select(schema.episodes.c.campaign, schema.episode_index)
            .join(
                schema.mode_members,
                (schema.mode_members.c.campaign == schema.episodes.c.campaign)
                & (schema.mode_members.c["index"] == schema.episode_index),
            )
            .where(
                schema.mode_members.c.analysis == analysis, schema.mode_members.c.number == number
            )
            .order_by(
                column.is_(None), last_first, schema.episodes.c.campaign, schema.episode_index
            )
            .limit(limit)
        )
        with self._database.reading() as connection:
            chosen = [(owner, index) for owner, index in connection.execute(query)]
            found = {
                (owner, row.index): row
                for owner in {owner for owner, _ in chosen}
                for row in _rows(connection, owner, [at for own, at in chosen if own == owner])
            }
        return [found[place] for place in chosen]

    def finished(self, campaign: int, indices: Iterable[int]) -> list[EpisodeResult]:
        """Return the results of the given episodes that have one, in index order.

        They come without scenes, and without the robustness of each requirement.

        Raises:
            NoisePruned: the noise of one of them was pruned.
        """
        query = _RESULTS.where(schema.episodes.c.campaign == campaign).order_by(
            schema.episode_index
        )
        with self._database.reading() as connection:
            return [
                codec.to_result(found)
                for is_chosen in _select_indices(set(indices))
                for found in connection.execute(query.where(is_chosen)).mappings()
                if _has_result(found)
            ]

    def failure_portions(self, campaign: int) -> Iterator[records.Failures]:
        """Yield the noise of all failures, at most `PORTION` at a time, from one transaction.

        Values of z without effect are 0.
        """
        with self._database.reading() as connection:
            spec = connection.execute(_SPEC, {"campaign": campaign}).scalar()
            # Of one outcome, an index has the failures in order.
            collided = schema.episodes.c.outcome == Outcome.COLLISION
            query = (
                sa.select(schema.episode_index, schema.trajectories.c.z, schema.episodes.c.seed)
                .join(schema.trajectories, _SAME_TRAJECTORY)
                .where(schema.episodes.c.campaign == campaign)
                .where(schema.is_failure if codec.count_requirements(spec) else collided)
                .order_by(schema.episode_index)
                .execution_options(yield_per=records.PORTION)
            )
            for rows_ in connection.execute(query).partitions():
                indices, noise, seeds = zip(*rows_, strict=True)
                form = codec.to_noise_form(spec)
                yield records.Failures(
                    indices, tuple(codec.to_counted_z(z, form) for z in noise), seeds
                )

    def failure_courses(self, campaign: int) -> Iterator[records.FailureCourse]:
        """Yield the course of all failures whose scene is stored, in index order."""
        with self._database.reading() as connection:
            query = (
                sa.select(schema.episode_index, schema.scenes.c.scene)
                .join(schema.scenes, _SAME_SCENE)
                .where(schema.episodes.c.campaign == campaign, schema.is_failure)
                .order_by(schema.episode_index)
                .execution_options(yield_per=SCENES_AT_A_TIME)
            )
            for index, scene in connection.execute(query):
                yield codec.to_failure_course(index, scene)

    def mode_courses(
        self, analysis: int, campaign: int, most: int
    ) -> dict[int, tuple[int, tuple[records.FailureCourse, ...]]]:
        """Return the failures of a campaign in each mode of an analysis, by number of the mode.

        Args:
            analysis: id of the analysis.
            campaign: id of the campaign.
            most: number of failures of a mode whose course is read at most, evenly spaced.

        Returns:
            The number of failures, and the courses of failures whose scene is stored.
        """
        member = schema.mode_members.c
        of_campaign = (member.analysis == analysis) & (member.campaign == campaign)
        query = sa.select(member.number, member["index"]).where(of_campaign)
        with self._database.reading() as connection:
            indices: dict[int, list[int]] = {}
            for number, index in connection.execute(query.order_by(member["index"])):
                indices.setdefault(number, []).append(index)
            return {
                number: (len(found), _read_courses(connection, campaign, found, most))
                for number, found in sorted(indices.items())
            }

    def sample_severities(self, campaign: int, first: int) -> SeveritySample:
        """Return the severities of the failures from the index `first` on."""
        return self._database.read(totals.sample_severities, campaign, first)

    def paired(self, first: int, second: int) -> PairTotals:
        """Count episodes that both campaigns completed with one seed and source, by outcome."""
        return self._database.read(totals.count_pairs, first, second)

    def digest(self, campaign: int) -> str:
        """Return the SHA-256 over one line "index digest" for each result, in index order."""
        return self._database.read(campaign_rows.hash_results, campaign)


def _has_result(found: sa.RowMapping) -> bool:
    """Return whether an episode has a result; without its noise, it has none.

    Raises:
        NoisePruned: the episode's noise was pruned.
    """
    if found["z"] is None and found["pruned_ms"] is not None:
        raise make_pruned_error(
            found["campaign"], found["index"], found["source"], found["pruned_ms"]
        )
    return found["z"] is not None


def _select_indices(indices: set[int]) -> Iterator[listing.Expression]:
    """Yield conditions, each for one statement, that select these indices in rising order."""
    for chunk in chunks(indices):
        first, last = chunk[0], chunk[-1]
        # Those of a round follow each other: a range is faster than hundreds of parameters.
        follow = last - first + 1 == len(chunk)
        yield (
            schema.episode_index.between(first, last) if follow else schema.episode_index.in_(chunk)
        )


def _rows(
    connection: sa.Connection, campaign: int, indices: Sequence[int]
) -> list[records.EpisodeRow]:
    query = ROWS.where(schema.episodes.c.campaign == campaign)
    found: dict[int, records.EpisodeRow] = {}
    for chunk in chunks(set(indices)):
        judged = _read_requirements(connection, campaign, chunk)
        for row in connection.execute(query.where(schema.episode_index.in_(chunk))).mappings():
            index = row["index"]
            found[index] = codec.to_row(row, tuple(judged[index]))
    return [found[index] for index in indices]


def _read_requirements(
    connection: sa.Connection, campaign: int, indices: Sequence[int]
) -> defaultdict[int, list[float | None]]:
    """Return the robustness of the requirements by the index of the episode, in their order.

    The robustness of a requirement that was not judged is None. An episode without any has an empty
    list.
    """
    value = schema.requirement_values.c
    query = (
        sa.select(value["index"], value.requirement, value.robustness)
        .where(value.campaign == campaign, value["index"].in_(indices))
        .order_by(value["index"], value.requirement)
    )
    chosen = sa.select(schema.campaigns.c.spec).where(schema.campaigns.c.id == campaign)
    named = codec.count_requirements(connection.execute(chosen).scalar_one_or_none())
    judged: defaultdict[int, list[float | None]] = defaultdict(list)
    for index, requirement, robustness in connection.execute(query):
        judged[index] = judged[index] or [None] * named
        judged[index][requirement - 1] = robustness
    return judged


def _read_courses(
    connection: sa.Connection, campaign: int, indices: Sequence[int], most: int
) -> tuple[records.FailureCourse, ...]:
    count = min(most, len(indices))
    chosen = [indices[place * len(indices) // count] for place in range(count)]
    query = sa.select(schema.scenes.c["index"], schema.scenes.c.scene).where(
        schema.scenes.c.campaign == campaign, schema.scenes.c["index"].in_(chosen)
    )
    found = connection.execute(query.order_by(schema.scenes.c["index"]))
    return tuple(codec.to_failure_course(index, scene) for index, scene in found)
