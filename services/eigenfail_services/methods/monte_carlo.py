"""Direct Monte Carlo, the baseline: draws every disturbance from the disturbance model."""

from collections.abc import Sequence

import msgspec

from eigenfail.contracts import MethodTraits, ModeProbability
from eigenfail.values.episode import EpisodeResult, PriorSource
from eigenfail.values.learning import LearnerContext, Proposal, count_rounds_ahead
from eigenfail_services.methods import RoundSize, archive


class MonteCarlo:
    """Draws from p(x), without learning.

    Attributes:
        lookahead: 3, or as many rounds as `parallel` needs: no worker waits for the end of a round.
    """

    class Settings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
        """Settings of `monte_carlo`."""

        round_size: RoundSize = 100

    class _Facts(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
        """State without fields."""

    traits = MethodTraits(
        tolerates_delay=True,
        draws_from_prior=True,
        independent=True,
        learns=False,
        observes=False,
        pairable=True,
        mode_probability=ModeProbability.COUNTS,
        chart_mark=0,
        references={},
    )
    lookahead = 3

    def __init__(self, context: LearnerContext, settings: Settings) -> None:
        self._round_size = settings.round_size
        self.lookahead = count_rounds_ahead(context.parallel, self._round_size, self.lookahead)

    def propose(self, n: int) -> Proposal:
        """Return a round of draws from the prior."""
        # Workers draw the noise themselves, by the seed of the episode: no noise is sent.
        return Proposal((PriorSource(),) * min(n, self._round_size))

    def observe(self, results: Sequence[EpisodeResult]) -> None:
        """Do nothing: Monte Carlo does not learn."""

    def state(self) -> bytes:
        """Return a state that only names the method."""
        return archive.write("monte_carlo", self._Facts(), {})

    def restore(self, state: bytes) -> None:
        """Restore a state.

        Raises:
            ProtocolError: the bytes are not a state of this method.
        """
        archive.read("monte_carlo", state, self._Facts)
