"""What remembers learners."""

from typing import Protocol

from eigenfail.values import Estimate
from eigenfail.values.records import Job


class CheckpointStore(Protocol):
    """The learner's last states of each campaign, and what it then told.

    The one before the last is kept to fall back to, should the last one be damaged.
    """

    def save(
        self,
        campaign: int,
        checkpoint: bytes,
        estimate: Estimate | None = None,
        trained_episodes: int | None = None,
        claim: Job | None = None,
    ) -> None:
        """A new checkpoint, and what the campaign's learner told, all or nothing.

        Args:
            campaign: by its id.
            checkpoint: the learner's state and the open rounds; its SHA-256 is kept with it.
            estimate: of the failure probability.
            trained_episodes: how many it was trained with.
            claim: of who runs the campaign.

        Raises:
            NotFound: no such campaign.
            ClaimLost: the claim is no longer the campaign's; nothing is saved.
        """

    def load(self, campaign: int) -> bytes | None:
        """The newest checkpoint that is whole, if there is one.

        Raises:
            ProtocolError: there are checkpoints, and none is whole.
        """

    def recover(self, campaign: int, claim: Job | None = None) -> bytes | None:
        """The same, to go on from: newer ones that are damaged are dropped, with an event.

        Raises:
            NotFound: no such campaign.
            ClaimLost: the claim is no longer the campaign's.
            ProtocolError: there are checkpoints, and none is whole.
        """
