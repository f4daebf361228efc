"""Episodes by seed and outcome, in memory."""

from collections.abc import Sequence
from math import ceil

import numpy as np

from eigenfail.values import Outcome, Trials
from eigenfail.values.records import EpisodeRow


def trials(rows: Sequence[EpisodeRow], most: int) -> Trials:
    """The completed episodes, or every so-manyth of them; the rows are in index order."""
    done = [row for row in rows if row.outcome is not Outcome.FAILED]
    kept = done[:: max(1, ceil(len(done) / most))]
    return Trials(
        np.array([row.seed for row in kept], np.int64),
        np.array([row.outcome is Outcome.COLLISION for row in kept], np.bool_),
    )
