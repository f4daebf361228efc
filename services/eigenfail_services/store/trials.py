"""Episodes by seed and outcome, as the database streams them."""

from math import ceil

import numpy as np
from sqlalchemy import Connection, func, select

from eigenfail.values import Outcome, Trials
from eigenfail_services.store.episode_pages import number
from eigenfail_services.store.schema import episodes

CHUNK = 10_000
"""How many rows are fetched at a time."""

TRIAL = np.dtype([("seed", np.int64), ("failed", np.bool_)])


def trials(connection: Connection, campaign: int, most: int) -> Trials:
    """The completed episodes, or every so-manyth of them."""
    inside = (episodes.c.campaign == campaign, episodes.c.outcome != Outcome.FAILED)
    count = connection.execute(select(func.count()).where(*inside)).scalar_one()
    place = func.row_number().over(order_by=number).label("place")
    ranked = select(episodes.c.seed, episodes.c.outcome, place).where(*inside).subquery().c
    query = (
        select(ranked.seed, ranked.outcome)
        .where((ranked.place - 1) % max(1, ceil(count / most)) == 0)
        .order_by(ranked.place)
        .execution_options(yield_per=CHUNK)
    )
    rows = ((seed, outcome == Outcome.COLLISION) for seed, outcome in connection.execute(query))
    found = np.fromiter(rows, TRIAL)
    return Trials(found["seed"], found["failed"])
