"""Sums over what is remembered."""

from collections.abc import Sequence
from typing import Protocol

from eigenfail.values.pool import Pool
from eigenfail.values.records import Totals
from eigenfail.values.sample import MOST_SAMPLES, EpisodeSample
from eigenfail.values.worker import WorkerShare


class FigureStore(Protocol):
    """Sums over campaigns and their episodes, for those who look at much at once.

    Each verb asks a fixed number of questions, however many campaigns there are.
    """

    def totals(self, campaigns: Sequence[int]) -> dict[int, Totals]:
        """What `EpisodeStore.totals` says, of some campaigns by their ids."""

    def samples(self, campaign: int, most: int = MOST_SAMPLES) -> tuple[EpisodeSample, ...]:
        """At most so many of the completed episodes, evenly spread, in index order.

        Those whose index is a multiple of k, for the smallest k that is enough up to the largest
        index that has a result.
        """

    def workers(self, campaign: int) -> tuple[WorkerShare, ...]:
        """Who ran the episodes of a campaign; who ran most comes first, then by name."""

    def workers_since(self, at_ms: int) -> tuple[WorkerShare, ...]:
        """Who brought results since a moment, and of which campaigns; only these are counted."""

    def pools(self) -> tuple[Pool, ...]:
        """All campaigns by what they have in common and by method, the newest first."""
