"""Direct Monte Carlo: every disturbance from the disturbance model itself; the baseline."""

from collections.abc import Sequence
from typing import Annotated

import msgspec

from eigenfail.values import EpisodeResult, LearnerContext, PriorSource, Proposal
from eigenfail_services.methods import archive


class MonteCarlo:
    """Draws from p(x); there is nothing to learn.

    Attributes:
        lookahead: enough that no worker ever waits for the end of a round.
    """

    class Settings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
        """Settings of `monte_carlo`."""

        round_size: Annotated[
            int, msgspec.Meta(ge=1, le=100_000, description="episodes in a round")
        ] = 100

    class _Facts(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
        """Nothing needs to be remembered."""

    lookahead = 3

    def __init__(self, _context: LearnerContext, settings: Settings) -> None:
        self._round_size = settings.round_size

    def propose(self, n: int) -> Proposal:
        """A round of draws from the prior."""
        return Proposal((PriorSource(),) * min(n, self._round_size))

    def observe(self, results: Sequence[EpisodeResult]) -> None:
        """Nothing is learnt from results."""

    def state(self) -> bytes:
        """A state that says whose it is."""
        return archive.write("monte_carlo", self._Facts(), {})

    def restore(self, state: bytes) -> None:
        """Go on.

        Raises:
            ProtocolError: the bytes are not a state of this method.
        """
        archive.read("monte_carlo", state, self._Facts)
