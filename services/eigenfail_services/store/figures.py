"""Figures over campaigns and their episodes: totals, samples, workers and costs of methods."""

from collections.abc import Sequence
from math import ceil
from typing import Any

import msgspec
from sqlalchemy import Connection, Double, Select, cast, func, or_, select

from eigenfail.values import Outcome
from eigenfail.values.pool import Peers, Pool
from eigenfail.values.records import Totals
from eigenfail.values.sample import MOST_SAMPLES, EpisodeSample
from eigenfail.values.worker import WorkerShare
from eigenfail_services.store.engine import Database
from eigenfail_services.store.query_cache import CachedQueries
from eigenfail_services.store.schema import campaigns, episode_index, episodes, spec_field


def _read_samples(connection: Connection, campaign: int, most: int) -> tuple[EpisodeSample, ...]:
    """Return the completed episodes whose index is a multiple of the smallest sufficient k."""
    inside = episodes.c.campaign == campaign
    reach = connection.execute(select(func.coalesce(func.max(episode_index), -1)).where(inside))
    every = max(1, ceil((reach.scalar_one() + 1) / most))
    query = (
        select(episode_index, episodes.c.outcome, episodes.c.robustness_m)
        .where(inside, episode_index % every == 0, episodes.c.outcome != Outcome.FAILED)
        .order_by(episode_index)
    )
    return tuple(
        EpisodeSample(index, Outcome(outcome), robustness_m)
        for index, outcome, robustness_m in connection.execute(query)
    )


SECONDS_PER_HOUR = 3_600.0
_PEERS = Peers.__struct_fields__
_STRUCTURED = ("planner_settings", "scenario_parameters", "disturbance")


def _sum_pools(connection: Connection) -> tuple[Pool, ...]:
    hours = campaigns.c.active_s * cast(spec_field("instances"), Double) / SECONDS_PER_HOUR
    usd = hours * cast(spec_field("price_usd_per_hour"), Double)
    facts = (
        select(
            *(spec_field(name).label(name) for name in (*_PEERS, "method")),
            *(campaigns.c.id, campaigns.c.completed, campaigns.c.failures),
            *(hours.label("hours"), usd.label("usd")),
        )
        .order_by(campaigns.c.id)
        .subquery()
        .c
    )
    same = [facts[name] for name in (*_PEERS, "method")]
    newest = func.max(facts.id).label("newest")
    query = (
        select(
            *same,
            newest,
            func.count().label("campaigns"),
            func.sum(facts.completed).label("completed"),
            func.sum(facts.failures).label("failures"),
            func.sum(facts.hours).label("instance_hours"),
            func.sum(facts.usd).label("total_usd"),
        )
        .group_by(*same)
        .order_by(newest.desc())
    )
    return tuple(_to_pool(dict(found)) for found in connection.execute(query).mappings())


def _to_pool(found: dict[str, Any]) -> Pool:
    given = {name: found.pop(name) for name in _PEERS}
    parts = {name: msgspec.json.decode(given[name]) for name in _STRUCTURED}
    return Pool(peers=msgspec.convert(given | parts, Peers), **found)


_SHARES = (
    select(
        episodes.c.worker,
        episodes.c.campaign,
        func.count().label("episodes"),
        func.count().filter(episodes.c.outcome == Outcome.COLLISION).label("failures"),
        func.count().filter(episodes.c.outcome == Outcome.FAILED).label("failed"),
        func.sum(episodes.c.wall_s).label("wall_s"),
        func.max(episodes.c.finished_ms).label("last_ms"),
    )
    .group_by(episodes.c.worker, episodes.c.campaign)
    .order_by(func.count().desc(), episodes.c.worker, episodes.c.campaign)
)


def _count_by_worker(connection: Connection, campaign: int) -> tuple[WorkerShare, ...]:
    # In the order of landing the rows are where they were written, one behind the other.
    inside = (episodes.c.campaign == campaign, episodes.c.finished_ms >= 0)
    return _read_shares(connection, _SHARES.where(*inside))


def _count_by_worker_since(connection: Connection, at_ms: int) -> tuple[WorkerShare, ...]:
    """Count results since a moment by worker and campaign.

    Campaigns that ended before that moment are not read.
    """
    unended = or_(campaigns.c.ended_ms.is_(None), campaigns.c.ended_ms >= at_ms)
    # Not a join: a database may begin one with the episodes, all of them.
    inside = episodes.c.campaign.in_(select(campaigns.c.id).where(unended))
    return _read_shares(connection, _SHARES.where(inside, episodes.c.finished_ms >= at_ms))


def _read_shares(
    connection: Connection, query: Select[*tuple[Any, ...]]
) -> tuple[WorkerShare, ...]:
    return tuple(WorkerShare(**found) for found in connection.execute(query).mappings())


class FigureStore:
    """Sums over campaigns and their episodes.

    The number of queries of each method does not depend on the number of campaigns.
    """

    def __init__(self, database: Database, cached: CachedQueries) -> None:
        self._database = database
        self._cached = cached

    def totals(self, campaigns: Sequence[int]) -> dict[int, Totals]:
        """Return `EpisodeStore.totals` of several campaigns, by id."""
        return self._cached.totals(campaigns)

    def samples(self, campaign: int, most: int = MOST_SAMPLES) -> tuple[EpisodeSample, ...]:
        """Return at most `most` of the completed episodes, evenly spread, in index order.

        Their indices are multiples of k, for the smallest sufficient k up to the largest index that
        has a result.
        """
        return self._cached.once(_read_samples, campaign, most)

    def workers(self, campaign: int) -> tuple[WorkerShare, ...]:
        """Return the workers' shares in a campaign's episodes, the largest first, then by name."""
        return self._cached.once(_count_by_worker, campaign)

    def workers_since(self, at_ms: int) -> tuple[WorkerShare, ...]:
        """Return the shares of workers in the results since a moment, by campaign."""
        with self._database.reading() as connection:
            return _count_by_worker_since(connection, at_ms)

    def pools(self) -> tuple[Pool, ...]:
        """Return sums over campaigns with equal peers and method, the newest first."""
        with self._database.reading() as connection:
            return _sum_pools(connection)
