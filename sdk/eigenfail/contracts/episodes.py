"""What remembers episodes."""

from collections.abc import Iterable, Iterator, Sequence
from typing import Protocol

from eigenfail.filters import BY_INDEX, Conditions, Sort
from eigenfail.values import (
    BlockTotals,
    EpisodeResult,
    Page,
    PairTotals,
    SafetyTotals,
    SpendingTotals,
    Trials,
)
from eigenfail.values.records import Delivery, EpisodeRow, Failures, Totals, Verdict
from eigenfail.values.region import MOST_TRIALS
from eigenfail.values.safety import MOST_POINTS
from eigenfail.values.spending import MOST_LANDINGS


class EpisodeStore(Protocol):
    """Results of episodes: at most one for each, for good."""

    def commit(self, campaign: int, deliveries: Sequence[Delivery]) -> list[Verdict]:
        """Keep results, update the counts, and log alarms; one verdict for each delivery."""

    def add_death(self, campaign: int, index: int) -> int:
        """One more worker was lost while it ran this episode; how many that makes.

        Raises:
            NotFound: no such campaign.
        """

    def get(self, campaign: int, index: int) -> EpisodeResult:
        """One result with everything that is kept of it.

        Raises:
            NotFound: no such campaign, or the episode has no result.
            NoisePruned: its noise was taken away.
        """

    def page(
        self,
        campaign: int,
        limit: int,
        after: int | None = None,
        where: Conditions = (),
        sort: Sort = BY_INDEX,
    ) -> Page[EpisodeRow]:
        """Episodes that fulfil all conditions, in an order, behind the index `after` in it.

        By index, `after` may be any number; in another order it is that of an episode with a
        result, behind which rows follow each other without gap or overlap, whatever comes in.
        """

    def finished(self, campaign: int, indices: Iterable[int]) -> list[EpisodeResult]:
        """Those of the episodes that have a result, in index order, without their scenes.

        Raises:
            NoisePruned: the noise of one of them was taken away.
        """

    def failures(self, campaign: int) -> Failures:
        """The noise of all collisions."""

    def failure_portions(self, campaign: int) -> Iterator[Failures]:
        """The same, at most `PORTION` at a time, of one moment: for those who keep less of it."""

    def totals(self, campaign: int) -> Totals:
        """Sums over all collisions, and episodes counted by class, as `assess` classifies them."""

    def course(self, campaign: int, per: int) -> list[BlockTotals]:
        """Sums over blocks of `per` indices, in index order, of those with a completed episode."""

    def safety(self, campaign: int, most: int = MOST_POINTS) -> SafetyTotals:
        """Safety measures over the completed episodes, with at most so many points.

        Where there are more failures with a severity than `most`, the points are every k-th of
        them in index order from the first one on, for the smallest k that is enough.
        """

    def trials(self, campaign: int, most: int = MOST_TRIALS) -> Trials:
        """Seeds and outcomes of the completed episodes in index order.

        Where there are more than `most`, of every k-th from the first one on, for the smallest k
        that is enough.
        """

    def spending(self, campaign: int, most: int = MOST_LANDINGS) -> SpendingTotals:
        """Worker time in the episodes, and when they landed.

        The landings are every k-th completed episode by the time that it was stored, then by
        index, for the smallest k that leaves at most so many; and the last one.
        """

    def paired(self, first: int, second: int) -> PairTotals:
        """The episodes that two campaigns both completed, with one seed and kind of source."""

    def digest(self, campaign: int) -> str:
        """SHA-256 over the digests of all results in index order, one line "index digest" each."""
