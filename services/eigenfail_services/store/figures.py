"""Sums over campaigns and their episodes in SQL."""

from collections.abc import Sequence

from eigenfail.values.pool import Pool
from eigenfail.values.records import Totals
from eigenfail.values.sample import MOST_SAMPLES, EpisodeSample
from eigenfail.values.worker import WorkerShare
from eigenfail_services.store.engine import Database
from eigenfail_services.store.pools import pools
from eigenfail_services.store.remembered import Remembered
from eigenfail_services.store.samples import samples
from eigenfail_services.store.workers import workers, workers_since


class SqlFigures:
    """Each verb asks a fixed number of questions, however many campaigns there are."""

    def __init__(self, database: Database, remembered: Remembered) -> None:
        self._database = database
        self._remembered = remembered

    def totals(self, campaigns: Sequence[int]) -> dict[int, Totals]:
        """Sums over the episodes of some campaigns, by their ids."""
        return self._remembered.totals(campaigns)

    def samples(self, campaign: int, most: int = MOST_SAMPLES) -> tuple[EpisodeSample, ...]:
        """At most so many of the completed episodes, evenly spread."""
        return self._remembered.once(samples, campaign, most)

    def workers(self, campaign: int) -> tuple[WorkerShare, ...]:
        """Who ran the episodes of a campaign."""
        return self._remembered.once(workers, campaign)

    def workers_since(self, at_ms: int) -> tuple[WorkerShare, ...]:
        """Who brought results since then, and of which campaigns."""
        with self._database.reading() as connection:
            return workers_since(connection, at_ms)

    def pools(self) -> tuple[Pool, ...]:
        """All campaigns by peers and method, the newest first."""
        with self._database.reading() as connection:
            return pools(connection)
