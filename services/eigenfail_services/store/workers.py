"""Who ran the episodes, counted by the database."""

from typing import Any

from sqlalchemy import Connection, Select, func, or_, select

from eigenfail.values import Outcome
from eigenfail.values.worker import WorkerShare
from eigenfail_services.store.schema import campaigns, episodes

SHARES = (
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


def workers(connection: Connection, campaign: int) -> tuple[WorkerShare, ...]:
    """Who ran the episodes of a campaign; who ran most comes first."""
    # In the order of landing the rows are where they were written, one behind the other.
    inside = (episodes.c.campaign == campaign, episodes.c.finished_ms >= 0)
    return shares(connection, SHARES.where(*inside))


def workers_since(connection: Connection, at_ms: int) -> tuple[WorkerShare, ...]:
    """Who brought results since then, and of which campaigns; only these are counted.

    Only campaigns that have not ended before are looked at.
    """
    unended = or_(campaigns.c.ended_ms.is_(None), campaigns.c.ended_ms >= at_ms)
    # Not a join: a database may begin one with the episodes, all of them.
    inside = episodes.c.campaign.in_(select(campaigns.c.id).where(unended))
    return shares(connection, SHARES.where(inside, episodes.c.finished_ms >= at_ms))


def shares(connection: Connection, query: Select[*tuple[Any, ...]]) -> tuple[WorkerShare, ...]:
    """The answer as values."""
    return tuple(WorkerShare(**found) for found in connection.execute(query).mappings())
