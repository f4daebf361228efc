"""Subset simulation as a learner (Au and Beck 2001); see `statistics.subset_simulation`."""

from collections.abc import Sequence
from typing import Annotated

import msgspec
import numpy as np

from eigenfail.values import (
    EpisodeResult,
    Estimate,
    LearnerContext,
    Proposal,
    TrajectorySource,
)
from eigenfail_services.methods import archive
from eigenfail_services.methods.robustness import robustness_m
from eigenfail_services.methods.subset.settings import SubsetMethodSettings
from eigenfail_services.methods.subset.waves import Dialogue, Waves
from eigenfail_services.statistics.independent_runs import pooled, underway

LARGEST_ROUND = 5_000_000
"""Numbers of noise in a round at most: it travels as one message."""


class SubsetMethod:
    """Goes down the levels of robustness until failures are reached, in several runs side by side.

    All runs ask for a wave of episodes at a time: draws from the prior on the first level, a move
    of every chain after that. It ends when all runs have. Its first run is `subset_simulation`
    with the learner's seed. It remembers the robustness of every episode and nothing else: the
    noise follows from that and the seed.

    Attributes:
        lookahead: none: each wave depends on the one before.

    Raises:
        InvalidValue: the budget allows too few samples.
    """

    Settings = SubsetMethodSettings

    class _Facts(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
        """What the state holds besides robustness: how many of a wave's episodes were proposed."""

        proposed: Annotated[int, msgspec.Meta(ge=0)]

    lookahead = 0

    def __init__(self, context: LearnerContext, settings: SubsetMethodSettings) -> None:
        self._context = context
        self._runs = settings.runs
        self._round_size = min(settings.round_size, 1 + LARGEST_ROUND // (2 * context.horizon))
        self._each = settings.within(context.episodes)
        self._waves = self._begun()

    def propose(self, n: int) -> Proposal:
        """What is left of the wave, at most a round; nothing once all runs have ended."""
        chosen = self._waves.next(min(n, self._round_size)).astype(np.float32)
        return Proposal(tuple(map(TrajectorySource, chosen)))

    def observe(self, results: Sequence[EpisodeResult]) -> None:
        """Once the wave is whole, go on to the next."""
        self._waves.hear([robustness_m(result) for result in results])

    def estimate(self) -> Estimate | None:
        """The failure probability once all runs have ended, what is known of it before that."""
        dialogues = self._waves.dialogues
        found = [one.found for one in dialogues if one.found is not None]
        if len(found) == self._runs:
            return pooled(found, self._each.samples)
        simulations = [one.simulation for one in dialogues]
        ran = sum(one.evaluations for one in simulations)
        spent = len(self._waves.robustness) >= self._context.episodes
        return underway([one.levels for one in simulations], ran, spent)

    def state(self) -> bytes:
        """The robustness of all episodes so far."""
        values: archive.Array = np.array(self._waves.robustness, np.float64)
        facts = self._Facts(self._waves.proposed)
        return archive.write("subset", facts, {"robustness_m": values})

    def restore(self, state: bytes) -> None:
        """Go through it again, up to there, bit for bit.

        Raises:
            ProtocolError: the bytes are not a state of this method.
        """
        facts, arrays = archive.read("subset", state, self._Facts)
        waves = self._begun()
        with archive.refusing("subset"):
            waves.hear(arrays["robustness_m"].astype(np.float64).tolist())
        waves.proposed = facts.proposed
        self._waves = waves

    def _begun(self) -> Waves:
        steps, seed = self._context.horizon, self._context.seed
        return Waves([Dialogue(steps, self._each, (seed, run)) for run in range(self._runs)])
