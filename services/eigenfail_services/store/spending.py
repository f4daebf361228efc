"""The time in a campaign's episodes, and when they landed, made by the database."""

from math import ceil

from sqlalchemy import Connection, Integer, and_, cast, func, or_, select

from eigenfail.values import Landing, Outcome, SpendingTotals
from eigenfail_services.store.episode_pages import number
from eigenfail_services.store.schema import episodes


def spending(connection: Connection, campaign: int, most: int) -> SpendingTotals:
    """Worker time in all episodes, and at most so many landings beside the last one."""
    # In index order: sums of floats depend on theirs, and reports must not change with it.
    inside = select(episodes).where(episodes.c.campaign == campaign).order_by(number).subquery().c
    failed = inside.outcome == Outcome.FAILED
    query = select(
        func.count().filter(~failed).label("completed"),
        func.coalesce(func.sum(inside.wall_s).filter(~failed), 0.0).label("completed_s"),
        func.coalesce(func.sum(inside.wall_s).filter(failed), 0.0).label("failed_s"),
    )
    found = connection.execute(query).one()
    every = max(1, ceil(found.completed / most))
    landed = landings(connection, campaign, found.completed, every)
    return SpendingTotals(found.completed_s, found.failed_s, landed)


def landings(
    connection: Connection, campaign: int, completed: int, every: int
) -> tuple[Landing, ...]:
    """Every so-manyth completed episode in the order of landing, and the last one."""
    order = (episodes.c.finished_ms, number)
    crash = cast(episodes.c.outcome == Outcome.COLLISION, Integer)
    ranked = (
        select(
            episodes.c.finished_ms,
            func.row_number().over(order_by=order).label("place"),
            func.sum(crash).over(order_by=order).label("failures"),
        )
        .where(and_(episodes.c.campaign == campaign, episodes.c.outcome != Outcome.FAILED))
        .subquery()
        .c
    )
    query = (
        select(ranked.finished_ms, ranked.place, ranked.failures)
        .where(or_(ranked.place % every == 0, ranked.place == completed))
        .order_by(ranked.place)
    )
    return tuple(
        Landing(at, place, int(crashes)) for at, place, crashes in connection.execute(query)
    )
