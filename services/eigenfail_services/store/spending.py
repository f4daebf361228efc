"""The time in a campaign's episodes, and when they landed, summed up by the database."""

from math import ceil, fsum
from typing import Any

from sqlalchemy import Connection, Select, func, or_, select

from eigenfail.values import Landing, Outcome, SpendingTotals
from eigenfail_services.store.episode_pages import number
from eigenfail_services.store.schema import episodes

DONE = episodes.c.outcome != Outcome.FAILED


def spending(connection: Connection, campaign: int, most: int) -> SpendingTotals:
    """Worker time in all episodes, and at most so many landings beside the last one."""
    inside = episodes.c.campaign == campaign
    completed = connection.execute(select(func.count()).where(inside, DONE)).scalar_one()
    failed = select(episodes.c.wall_s).where(inside, ~DONE)
    found = connection.execute(landings(campaign, completed, most)).all()
    return SpendingTotals(
        completed_worker_s=found[-1].worker_s if found else 0.0,
        failed_worker_s=fsum(connection.execute(failed).scalars()),
        landings=tuple(Landing(each.finished_ms, each.place, each.failures) for each in found),
    )


def landings(campaign: int, completed: int, most: int) -> Select[*tuple[Any, ...]]:
    """Every so-manyth completed episode in the order of landing, and the last one.

    With each goes what there was until then: episodes, collisions and worker time.
    """
    order = (episodes.c.finished_ms, number)
    # By rows, not by range: two that landed at the same time are two.
    until = (None, 0)
    crashes = func.count().filter(episodes.c.outcome == Outcome.COLLISION)
    landed = (
        select(
            episodes.c.finished_ms,
            func.row_number().over(order_by=order).label("place"),
            crashes.over(order_by=order, rows=until).label("failures"),
            func.sum(episodes.c.wall_s).over(order_by=order, rows=until).label("worker_s"),
        )
        .where(episodes.c.campaign == campaign, DONE)
        .subquery()
        .c
    )
    every = max(1, ceil(completed / most))
    chosen = or_(landed.place % every == 0, landed.place == completed)
    return select(*landed).where(chosen).order_by(landed.place)
