"""The time in a campaign's episodes, and when they landed, in memory."""

from collections.abc import Sequence
from itertools import accumulate
from math import ceil, fsum

from eigenfail.values import Landing, Outcome, SpendingTotals
from eigenfail.values.records import EpisodeRow


def spending(rows: Sequence[EpisodeRow], most: int) -> SpendingTotals:
    """Worker time in all episodes, and at most so many landings beside the last one."""
    done = [row for row in rows if row.outcome is not Outcome.FAILED]
    landed = sorted(done, key=lambda row: (row.finished_ms, row.index))
    failures = accumulate(int(row.outcome is Outcome.COLLISION) for row in landed)
    every = max(1, ceil(len(landed) / most))
    return SpendingTotals(
        completed_worker_s=fsum(row.wall_s for row in done),
        failed_worker_s=fsum(r.wall_s for r in rows if r.outcome is Outcome.FAILED),
        landings=tuple(
            Landing(row.finished_ms, place, crashes)
            for place, (row, crashes) in enumerate(zip(landed, failures, strict=True), 1)
            if place % every == 0 or place == len(landed)
        ),
    )
