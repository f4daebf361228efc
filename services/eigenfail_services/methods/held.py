"""Random noise that is held for some steps: the reference for every search.

Independent noise at each step averages out in the motion of a vehicle. Noise that keeps its value
for a second does not. This search works without a learner, and so shows the benefit of a learner.
"""

from collections.abc import Sequence
from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta

from eigenfail.contracts import MethodTraits
from eigenfail.values.arrays import Floats
from eigenfail.values.episode import EpisodeResult, TrajectorySource
from eigenfail.values.learning import LearnerContext, Proposal, count_rounds_ahead
from eigenfail_services.methods import Hold, RoundSize, archive


class HeldNoiseSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Settings of `held`."""

    hold: Hold = 10
    scale: Annotated[
        float,
        Meta(gt=0.0, le=100.0, description="standard deviation of the values [sigma]"),
    ] = 1.0
    round_size: RoundSize = 100


class HeldNoise:
    """Draws each value of z from N(0, scale²) and holds it for some steps, without learning.

    Each channel of each episode has its own random phase, so a change may occur at any step.

    Attributes:
        lookahead: 3, or as many rounds as `parallel` needs: no worker waits for the end of a round.
    """

    Settings = HeldNoiseSettings

    class _Facts(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
        """Number of proposed rounds."""

        rounds: int

    traits = MethodTraits(
        tolerates_delay=True,
        independent=True,
        learns=False,
        observes=False,
        pairable=True,
        chart_mark=9,
        references={},
    )
    lookahead = 3

    def __init__(self, context: LearnerContext, settings: HeldNoiseSettings) -> None:
        self._seed = context.seed
        self._horizon = context.horizon
        self._channels = context.channels
        self._settings = settings
        self._rounds = 0
        self.lookahead = count_rounds_ahead(context.parallel, settings.round_size, self.lookahead)

    def propose(self, n: int) -> Proposal:
        """Return a round of held noise, which depends on the seed and the round's number."""
        random = np.random.default_rng([self._seed, self._rounds])
        # The number of the round seeds its draws: a state needs no generator.
        self._rounds += 1
        count = min(n, self._settings.round_size)
        return Proposal(tuple(TrajectorySource(self._draw(random)) for _ in range(count)))

    def _draw(self, random: np.random.Generator) -> Floats:
        hold, channels = self._settings.hold, self._channels
        # A phase moves the last step by up to hold − 1 steps: two values more than there are whole
        # holds cover it.
        values = random.normal(0.0, self._settings.scale, (self._horizon // hold + 2, channels))
        phases = random.integers(0, hold, channels)
        steps = np.arange(self._horizon)[:, None] + phases
        noise: Floats = values[steps // hold, np.arange(channels)].astype(np.float32)
        return noise

    def observe(self, results: Sequence[EpisodeResult]) -> None:
        """Do nothing: held noise does not learn."""

    def state(self) -> bytes:
        """Return a state with the number of rounds."""
        return archive.write("held", self._Facts(self._rounds), {})

    def restore(self, state: bytes) -> None:
        """Restore a state.

        Raises:
            ProtocolError: the bytes are not a state of this method.
        """
        facts, _ = archive.read("held", state, self._Facts)
        self._rounds = facts.rounds
