"""What was worked out of results, asked of the database once for as long as none comes in."""

from collections.abc import Callable, Sequence
from typing import Concatenate, ParamSpec, TypeVar

from sqlalchemy import Connection

from eigenfail.values.records import Totals
from eigenfail_services.store.engine import Database
from eigenfail_services.store.memo import Memo
from eigenfail_services.store.totals import results, totals

Answer = TypeVar("Answer")
More = ParamSpec("More")

MOST_TOTALS = 20_000


class Remembered:
    """Questions about campaigns' results, each answered from memory while nothing has changed.

    Who follows a campaign asks the same over and over, and so does everybody beside: a campaign
    that has ended is read once, and one that runs once for all who look at the same time.
    """

    def __init__(self, database: Database) -> None:
        self._database = database
        self._memo = Memo()
        self._totals = Memo(MOST_TOTALS)

    def once(
        self,
        question: Callable[Concatenate[Connection, int, More], Answer],
        campaign: int,
        *more: More.args,
        **options: More.kwargs,
    ) -> Answer:
        """The answer to a question about a campaign's results."""

        def ask() -> Answer:
            with self._database.reading() as connection:
                return question(connection, campaign, *more, **options)

        key = (question.__name__, campaign, *more, *sorted(options.items()))
        # No connection is held meanwhile: those who wait for the answer need none.
        return self._memo.get(key, self._results([campaign]).get(campaign, 0), ask)

    def totals(self, campaigns: Sequence[int]) -> dict[int, Totals]:
        """Sums over each of some campaigns; those that are not known yet, all at once."""
        counts = self._results(campaigns)
        known = {each: self._totals.known(each, counts.get(each, 0)) for each in campaigns}
        missing = [each for each, found in known.items() if found is None]
        if missing:
            with self._database.reading() as connection:
                fresh = totals(connection, missing)
            for each, found in fresh.items():
                self._totals.put(each, counts.get(each, 0), found)
            known |= fresh
        return known

    def _results(self, campaigns: Sequence[int]) -> dict[int, int]:
        with self._database.reading() as connection:
            return results(connection, campaigns)
