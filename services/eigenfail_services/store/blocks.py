"""Sums over blocks of episodes, and over pairs of them, made by the database."""

from statistics import fmean

from sqlalchemy import Column, Connection, and_, func, select

from eigenfail.values import BlockTotals, Outcome, PairTotals
from eigenfail_services.store.episode_pages import Rows, number
from eigenfail_services.store.schema import episodes


def course(connection: Connection, campaign: int, per: int) -> list[BlockTotals]:
    """Sums over blocks of `per` indices, in index order, of those with a completed episode."""
    last = connection.execute(
        select(func.coalesce(func.max(number), -1)).where(episodes.c.campaign == campaign)
    ).scalar_one()
    blocks = (block(connection, campaign, first, per) for first in range(0, last + 1, per))
    return [each for each in blocks if each.completed]


def block(connection: Connection, campaign: int, first: int, per: int) -> BlockTotals:
    """Sums over the completed episodes from an index on."""
    # In index order: sums of floats depend on theirs, and reports must not change with it.
    inside = completed(campaign, first, per).order_by(number).subquery().c
    collided = inside.outcome == Outcome.COLLISION
    query = select(
        func.count().label("completed"),
        func.count().filter(collided).label("failures"),
        func.coalesce(func.sum(inside.log_probability).filter(collided), 0.0).label("log_p"),
        func.coalesce(func.sum(inside.steps).filter(collided), 0).label("steps"),
        func.min(inside.robustness_m).label("smallest"),
        func.count(inside.robustness_m).label("measured"),
    )
    found = connection.execute(query).one()
    return BlockTotals(
        first=first,
        completed=found.completed,
        failures=found.failures,
        log_probability=found.log_p,
        steps=found.steps,
        smallest_robustness_m=found.smallest,
        median_robustness_m=median(
            connection,
            completed(campaign, first, per),
            episodes.c.robustness_m,
            found.measured,
        ),
    )


def median(
    connection: Connection, inside: Rows, column: Column[float], measured: int
) -> float | None:
    """The median of a column that so many of the rows have, with only its middle values read."""
    if not measured:
        return None
    query = (
        inside.with_only_columns(column)
        .where(column.is_not(None))
        .order_by(column)
        .offset((measured - 1) // 2)
        .limit(2 - measured % 2)
    )
    return fmean(connection.execute(query).scalars())


def completed(campaign: int, first: int, per: int) -> Rows:
    """The completed episodes of a block."""
    return select(episodes).where(
        episodes.c.campaign == campaign,
        number.between(first, first + per - 1),
        episodes.c.outcome != Outcome.FAILED,
    )


def paired(connection: Connection, first: int, second: int) -> PairTotals:
    """The episodes that two campaigns both completed, with one seed and kind of source."""
    other = episodes.alias()
    same = and_(
        other.c["index"] == number,
        other.c.seed == episodes.c.seed,
        other.c.source == episodes.c.source,
    )
    one_failed = episodes.c.outcome == Outcome.COLLISION
    other_failed = other.c.outcome == Outcome.COLLISION
    query = (
        select(
            func.count().filter(one_failed, other_failed).label("both"),
            func.count().filter(one_failed, ~other_failed).label("only_first"),
            func.count().filter(~one_failed, other_failed).label("only_second"),
            func.count().filter(~one_failed, ~other_failed).label("neither"),
        )
        .select_from(episodes)
        .join(other, same)
        .where(
            episodes.c.campaign == first,
            other.c.campaign == second,
            episodes.c.outcome != Outcome.FAILED,
            other.c.outcome != Outcome.FAILED,
        )
    )
    return PairTotals(*connection.execute(query).one())
