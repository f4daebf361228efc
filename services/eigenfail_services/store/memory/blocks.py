"""Sums over blocks of episodes, and over pairs of them, in memory."""

from collections import Counter
from collections.abc import Sequence
from itertools import groupby
from statistics import median

from eigenfail.values import BlockTotals, Outcome, PairTotals
from eigenfail.values.records import EpisodeRow


def course(rows: Sequence[EpisodeRow], per: int) -> list[BlockTotals]:
    """Sums over blocks of `per` indices; the rows are in index order."""
    done = [row for row in rows if row.outcome is not Outcome.FAILED]
    blocks = groupby(done, lambda row: row.index - row.index % per)
    return [block(first, list(inside)) for first, inside in blocks]


def block(first: int, rows: Sequence[EpisodeRow]) -> BlockTotals:
    """Sums over one block."""
    collisions = [row for row in rows if row.outcome is Outcome.COLLISION]
    measured = [row.robustness_m for row in rows if row.robustness_m is not None]
    return BlockTotals(
        first=first,
        completed=len(rows),
        failures=len(collisions),
        log_probability=sum((row.log_probability for row in collisions), 0.0),
        steps=sum(row.steps for row in collisions),
        smallest_robustness_m=min(measured, default=None),
        median_robustness_m=median(measured) if measured else None,
    )


def paired(first: Sequence[EpisodeRow], second: Sequence[EpisodeRow]) -> PairTotals:
    """The episodes of both that were completed with one seed and kind of source."""
    others = {(row.index, row.seed, row.source): row.outcome for row in second}
    met = ((row.outcome, others.get((row.index, row.seed, row.source))) for row in first)
    pairs = Counter(met)
    crashed, safe = Outcome.COLLISION, Outcome.SAFE
    return PairTotals(
        both=pairs[crashed, crashed],
        only_first=pairs[crashed, safe],
        only_second=pairs[safe, crashed],
        neither=pairs[safe, safe],
    )
