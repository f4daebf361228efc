"""Seeds and outcomes of the episodes of a campaign, from the tables of the store."""

from math import ceil

import msgspec
import numpy as np
import sqlalchemy as sa
from numpy.typing import NDArray

from eigenfail.values.episode import FAILURES, Outcome
from eigenfail_services.store.engine import Database
from eigenfail_services.store.schema import episode_index, episodes

CHUNK = 10_000
"""Number of rows that are fetched at a time."""

TRIAL = np.dtype([("seed", np.int64), ("failed", np.bool_)])


class Trials(msgspec.Struct, frozen=True, eq=False):
    """Completed episodes of a campaign, by seed and outcome: all, or every k-th in index order.

    Attributes:
        seeds: seed of each episode's parameters, shape (n,).
        failed: whether each of them is a failure, shape (n,).
    """

    seeds: NDArray[np.int64]
    failed: NDArray[np.bool_]


def read_trials(database: Database, campaign: int, most: int) -> Trials:
    """Return seeds and outcomes of the completed episodes in index order.

    If there are more than `most`, of every k-th from the first one on, for the smallest
    sufficient k.
    """
    inside = (episodes.c.campaign == campaign, episodes.c.outcome != Outcome.ERRORED)
    place = sa.func.row_number().over(order_by=episode_index).label("place")
    ranked = sa.select(episodes.c.seed, episodes.c.outcome, place).where(*inside).subquery().c
    with database.reading() as connection:
        count = connection.execute(sa.select(sa.func.count()).where(*inside)).scalar_one()
        query = (
            sa.select(ranked.seed, ranked.outcome)
            .where((ranked.place - 1) % max(1, ceil(count / most)) == 0)
            .order_by(ranked.place)
            .execution_options(yield_per=CHUNK)
        )
        rows = ((seed, outcome in FAILURES) for seed, outcome in connection.execute(query))
        found = np.fromiter(rows, TRIAL)
    return Trials(found["seed"], found["failed"])
