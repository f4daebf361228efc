"""What makes room in a store, and remembers what is gone."""

from typing import Protocol

from eigenfail.values.retention import Pruning, Retention, Weight


class RetentionStore(Protocol):
    """Noise and scenes that go to make room; rows, failures and every so-manyth episode stay."""

    def weigh(self, campaign: int, rule: Retention) -> Weight:
        """What goes by a rule, if it is applied now.

        Raises:
            NotFound: no such campaign.
        """

    def prune(
        self, campaign: int, rule: Retention, who: str, begun: int | None = None
    ) -> Pruning | None:
        """Take away the next slice of it, in index order, and record it, all or nothing.

        Args:
            campaign: by its id.
            rule: which episodes keep their noise.
            who: in words, for the record.
            begun: the record to go on with, by its id; None begins one, with an event.

        Returns:
            The record so far; None where nothing (more) goes, and nothing was changed.

        Raises:
            NotFound: no such campaign.
            Conflict: it has not ended, or others need its noise that have not: see `in_use`. No
                campaign that names it is made meanwhile.
        """

    def in_use(self) -> frozenset[int]:
        """Campaigns that settings of others name which have not ended, or that are analysed.

        These learn from their noise, or inject it again.
        """

    def of(self, campaign: int) -> tuple[Pruning, ...]:
        """What was taken from a campaign, oldest first."""
