"""An ability of learners: to say how likely what they draw was to be drawn."""

from collections.abc import Sequence
from typing import Protocol, runtime_checkable

from eigenfail.values import EpisodeResult, Estimate
from eigenfail_services.statistics.importance import WeightedFailures


@runtime_checkable
class Weigher(Protocol):
    """An exploiter whose draws have a known density q, so that they tell P(failure) under p."""

    def weigh(self, sums: WeightedFailures, results: Sequence[EpisodeResult]) -> WeightedFailures:
        """The sums with episodes that `exploit` proposed, from what is known now."""

    def tell(self, sums: WeightedFailures, horizon: int) -> Estimate | None:
        """The probability that such sums tell; None where they tell none.

        Args:
            sums: of all episodes that count.
            horizon: the number of steps of a full episode.
        """
