"""A cache of what was computed from campaigns' results.

Results are only ever added, so an answer holds as long as their number is the same.
"""

from collections import OrderedDict
from collections.abc import Callable, Hashable, Sequence
from threading import Lock
from typing import Any, Concatenate, ParamSpec, TypeVar

from sqlalchemy import Connection

from eigenfail.values.records import Totals
from eigenfail_services.store.engine import Database
from eigenfail_services.store.totals import count_results, sum_campaigns

Answer = TypeVar("Answer")

MOST_ANSWERS = 512


class _Entry:
    """An answer, the number of results that it is of, and a lock for its computation."""

    def __init__(self) -> None:
        self.lock = Lock()
        self.results = -1
        self.answer: Any = None


class AnswerCache:
    """The latest answers about campaigns; each is computed once, however many threads ask for it.

    Args:
        most: number of answers that are kept.
    """

    def __init__(self, most: int = MOST_ANSWERS) -> None:
        self._most = most
        self._lock = Lock()
        self._entries: OrderedDict[Hashable, _Entry] = OrderedDict()

    def get(self, key: Hashable, results: int, make: Callable[[], Answer]) -> Answer:
        """Return the answer to a question of at least `results` results, computed if necessary."""
        entry = self._entry(key)
        with entry.lock:
            if entry.results < results:
                entry.answer, entry.results = make(), results
            answer: Answer = entry.answer
            return answer

    def known(self, key: Hashable, results: int) -> Any:
        """Return the answer of at least `results` results if it is cached, else None."""
        entry = self._entry(key)
        with entry.lock:
            return entry.answer if entry.results >= results else None

    def put(self, key: Hashable, results: int, answer: object) -> None:
        """Cache an answer that was computed elsewhere."""
        entry = self._entry(key)
        with entry.lock:
            if entry.results < results:
                entry.answer, entry.results = answer, results

    def _entry(self, key: Hashable) -> _Entry:
        with self._lock:
            entry = self._entries.pop(key, None) or _Entry()
            self._entries[key] = entry
            if len(self._entries) > self._most:
                self._entries.popitem(last=False)
            return entry


More = ParamSpec("More")

MOST_TOTALS = 20_000


class CachedQueries:
    """Queries of campaigns' results, answered from a cache while no result was added.

    A campaign that has ended is read once, and a running one once for all that look at it at the
    same time.
    """

    def __init__(self, database: Database) -> None:
        self._database = database
        self._answers = AnswerCache()
        self._totals = AnswerCache(MOST_TOTALS)

    def once(
        self,
        question: Callable[Concatenate[Connection, int, More], Answer],
        campaign: int,
        *more: More.args,
        **options: More.kwargs,
    ) -> Answer:
        """Return the answer to a query of a campaign's results."""

        def ask() -> Answer:
            with self._database.reading() as connection:
                return question(connection, campaign, *more, **options)

        key = (question.__name__, campaign, *more, *sorted(options.items()))
        # No connection is held meanwhile: those who wait for the answer need none.
        return self._answers.get(key, self._results([campaign]).get(campaign, 0), ask)

    def totals(self, campaigns: Sequence[int]) -> dict[int, Totals]:
        """Return the totals of several campaigns; all that are not cached are read at once."""
        counts = self._results(campaigns)
        known = {each: self._totals.known(each, counts.get(each, 0)) for each in campaigns}
        missing = [each for each, found in known.items() if found is None]
        if missing:
            with self._database.reading() as connection:
                fresh = sum_campaigns(connection, missing)
            for each, found in fresh.items():
                self._totals.put(each, counts.get(each, 0), found)
            known |= fresh
        return known

    def _results(self, campaigns: Sequence[int]) -> dict[int, int]:
        with self._database.reading() as connection:
            return count_results(connection, campaigns)
