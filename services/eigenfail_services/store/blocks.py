"""Sums over blocks of episodes, and over pairs of them, made by the database."""

import numpy as np
from sqlalchemy import Connection, and_, func, select

from eigenfail.values import BlockTotals, Outcome, PairTotals
from eigenfail_services.store.columns import COLLIDED, Column, columns
from eigenfail_services.store.episode_pages import number
from eigenfail_services.store.schema import episodes


def course(connection: Connection, campaign: int, per: int) -> list[BlockTotals]:
    """Sums over blocks of `per` indices, in index order, of those with a completed episode."""
    query = (
        select(number, COLLIDED, episodes.c.robustness_m, episodes.c.log_probability)
        .add_columns(episodes.c.steps)
        .where(episodes.c.campaign == campaign, episodes.c.outcome != Outcome.FAILED)
        .order_by(episodes.c.finished_ms, number)
    )
    landed = columns(connection, query)
    # In index order: sums of floats depend on theirs, and reports must not change with it.
    index, *measured = (column[np.argsort(landed[0])] for column in landed)
    blocks, begins = np.unique(index // per, return_index=True)
    if not len(blocks):
        return []
    parts = zip(*(np.split(column, begins[1:]) for column in measured), strict=True)
    return [
        block(int(place) * per, *part) for place, part in zip(blocks.tolist(), parts, strict=True)
    ]


def block(
    first: int, collided: Column, robustness_m: Column, log_probability: Column, steps: Column
) -> BlockTotals:
    """Sums over the completed episodes of one block."""
    crashes = collided == 1.0
    known_m = robustness_m[~np.isnan(robustness_m)]
    return BlockTotals(
        first=first,
        completed=len(collided),
        failures=int(crashes.sum()),
        log_probability=sum(log_probability[crashes].tolist(), 0.0),
        steps=int(steps[crashes].sum()),
        smallest_robustness_m=float(known_m.min()) if len(known_m) else None,
        median_robustness_m=float(np.median(known_m)) if len(known_m) else None,
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
