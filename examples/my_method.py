"""A method of one's own: noise that climbs from a near miss to a failure. docs/own_method.md"""

from collections.abc import Sequence
from math import inf
from typing import Annotated

import msgspec
import numpy as np
from msgspec import Meta

from eigenfail.contracts import MethodTraits
from eigenfail.values.episode import EpisodeResult, TrajectorySource
from eigenfail.values.learning import LearnerContext, Proposal
from eigenfail_services.methods import archive


class HillClimbSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Settings of `hill_climb`."""

    step: Annotated[float, Meta(gt=0.0, le=5.0, description="size of a change [sigma]")] = 0.5
    hold: Annotated[int, Meta(ge=1, le=1000, description="steps for which a change is held")] = 10
    round_size: Annotated[int, Meta(ge=1, le=1000, description="episodes in a round")] = 20


class HillClimbFacts(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """State besides the best noise: rounds so far, and the smallest robustness. [m]"""

    rounds: int
    nearest_m: float


class HillClimb:
    """Changes the noise that came nearest to a failure, and keeps the change if it comes nearer."""

    Settings = HillClimbSettings
    traits = MethodTraits(references={})
    lookahead = 0  # a round starts from the best noise of all rounds before it

    def __init__(self, context: LearnerContext, settings: HillClimbSettings) -> None:
        self._seed, self._settings = context.seed, settings
        self._best = np.zeros((context.horizon, context.channels), np.float32)
        self._facts = HillClimbFacts(0, inf)

    def propose(self, n: int) -> Proposal:
        """Return a round of changes of the best noise."""
        hold, count = self._settings.hold, min(n, self._settings.round_size)
        steps, channels = self._best.shape
        # The number of the round seeds its draws: a state needs no generator.
        random = np.random.default_rng([self._seed, self._facts.rounds])
        self._facts = msgspec.structs.replace(self._facts, rounds=self._facts.rounds + 1)
        changes = random.normal(0.0, self._settings.step, (count, steps // hold + 1, channels))
        noise = self._best + np.repeat(changes, hold, axis=1)[:, :steps]
        return Proposal(tuple(TrajectorySource(z) for z in noise.astype(np.float32)))

    def observe(self, results: Sequence[EpisodeResult]) -> None:
        """Keep the noise of the episode that came nearest to a failure."""
        completed = [result for result in results if result.measures is not None]
        for result in completed:
            if result.measures.robustness_m < self._facts.nearest_m:
                nearest_m = result.measures.robustness_m
                self._facts = msgspec.structs.replace(self._facts, nearest_m=nearest_m)
                # Noise after the end of an episode had no effect.
                self._best = np.zeros_like(self._best)
                self._best[: result.steps] = result.noise.z

    def state(self) -> bytes:
        """Return the state, from which another learner goes on bit for bit."""
        return archive.write("hill_climb", self._facts, {"best": self._best})

    def restore(self, state: bytes) -> None:
        """Restore a state.

        Raises:
            ProtocolError: the bytes are not a state of this method.
        """
        facts, arrays = archive.read("hill_climb", state, HillClimbFacts)
        with archive.wrap_errors("hill_climb"):
            best = archive.take(arrays, "best", self._best.shape)
        self._facts, self._best = facts, best
