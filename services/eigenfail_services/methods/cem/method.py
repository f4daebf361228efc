"""The cross-entropy method as a learner (Rubinstein and Kroese 2004): draw, keep the best, fit.

The smoothing of what is fitted is that of de Boer et al. 2005, A Tutorial on the Cross-Entropy
Method, Annals of Operations Research 134, 19–67.
"""

from collections.abc import Sequence
from typing import Annotated

import msgspec
import numpy as np
from msgspec.structs import astuple

from eigenfail.values import (
    EpisodeResult,
    Estimate,
    Floats,
    LearnerContext,
    Outcome,
    Proposal,
    RoundSizes,
    TrajectorySource,
)
from eigenfail_services.methods import archive
from eigenfail_services.methods.cem.elite import elite
from eigenfail_services.methods.cem.proposal import (
    GaussianProposal,
    averaged,
    fit,
    log_weights,
    prior,
)
from eigenfail_services.statistics.importance import WeightedFailures, nothing_counted

ADVICE = (
    "Take method subset, or give it more episodes, larger rounds and no narrower noise: "
    "batch = 200, min_std = 1, mean_smoothing = 0.3."
)
BLANK = (0.0, *astuple(WeightedFailures()))
NO_SUMS: dict[str, archive.Array] = {"sums": np.array(BLANK)}
"""Of states that were written before there were sums."""

Smoothing = Annotated[float, msgspec.Meta(gt=0.0, le=1.0)]


class CemSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Settings of `cem`. It starts from the prior: mean 0, standard deviation 1 [sigma].

    With some hundred episodes, many small rounds find more than few large ones. Where the standard
    deviation may fall to sqrt(1/2), importance weights have no finite variance.
    """

    batch: Annotated[int, msgspec.Meta(ge=2, le=100_000, description="episodes in a round")] = 20
    elite_share: Annotated[
        float, msgspec.Meta(gt=0.0, lt=1.0, description="share of a round that is learnt from")
    ] = 0.1
    mean_smoothing: Annotated[
        Smoothing, msgspec.Meta(description="of the way to the elite's mean, this much is gone")
    ] = 0.7
    std_smoothing: Annotated[
        Smoothing, msgspec.Meta(description="the same for the standard deviation")
    ] = 0.3
    min_std: Annotated[
        float, msgspec.Meta(gt=0.0, le=1.0, description="smallest standard deviation [sigma]")
    ] = 0.9
    max_std: Annotated[
        float, msgspec.Meta(ge=1.0, le=10.0, description="largest standard deviation [sigma]")
    ] = 1.0
    max_mean: Annotated[
        float, msgspec.Meta(gt=0.0, le=10.0, description="largest |mean| [sigma]")
    ] = 2.0
    mean_window: Annotated[
        int,
        msgspec.Meta(
            ge=1, le=10_000, description="steps over which moves of the mean are averaged"
        ),
    ] = 9


class CrossEntropyMethod:
    """Moves a Gaussian of the noise towards failures, and among failures towards likely ones.

    Attributes:
        lookahead: none: each round is drawn from what all before it have taught.
        proposal: what the next round is drawn from; see `proposal.log_weights`.
    """

    Settings = CemSettings

    class _Facts(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
        """What the state holds besides arrays: how many rounds were drawn."""

        rounds: int

    lookahead = 0

    def __init__(self, context: LearnerContext, settings: CemSettings) -> None:
        self._settings = settings
        self._seed = context.seed
        self._rounds = 0
        self._budget = context.episodes
        self._seen = 0
        self._sums = WeightedFailures()
        self.proposal = prior(context.horizon)

    @staticmethod
    def round_sizes(settings: CemSettings, _episodes: int) -> RoundSizes:
        """One batch after the other."""
        return RoundSizes(settings.batch, settings.batch, "batch")

    def propose(self, n: int) -> Proposal:
        """A round of draws from the proposal."""
        return self.exploit(min(n, self._settings.batch))

    def exploit(self, n: int) -> Proposal:
        """Draws from the proposal as it stands."""
        random = np.random.default_rng([self._seed, self._rounds])
        self._rounds += 1
        draws = self.proposal.draw(n, random)
        return Proposal(tuple(TrajectorySource(z) for z in draws))

    def observe(self, results: Sequence[EpisodeResult]) -> None:
        """Move the proposal towards the elite; leave it where the round says nothing."""
        self._count(results)
        best = elite(results, self.proposal, self._settings.elite_share)
        if best:
            self.proposal = self._moved(*fit(best, self.proposal))

    def _count(self, results: Sequence[EpisodeResult]) -> None:
        """Weigh what was drawn from the proposal, once it has had half of the budget to learn.

        The few heavy weights of early rounds would outweigh all others, where they are drawn at
        all.
        """
        if self._seen >= self._budget // 2:
            self._sums = self.weigh(self._sums, results)
        self._seen += len(results)

    def weigh(self, sums: WeightedFailures, results: Sequence[EpisodeResult]) -> WeightedFailures:
        """With episodes that were drawn from the proposal as it stands."""
        ran = [result for result in results if result.outcome is not Outcome.FAILED]
        failures = [result.noise.z for result in ran if result.is_failure]
        return sums.after(log_weights(failures, self.proposal), len(ran))

    def tell(self, sums: WeightedFailures, _horizon: int) -> Estimate | None:
        """The failure probability by importance sampling; None over no episode."""
        return sums.estimate(ADVICE) if sums.episodes else None

    def estimate(self) -> Estimate | None:
        """The same over the second half of the budget."""
        told = self.tell(self._sums, len(self.proposal.mean))
        return told or nothing_counted(self._seen, self._budget)

    def state(self) -> bytes:
        """The proposal, how many rounds it took, and the sums of the weights."""
        arrays: dict[str, archive.Array] = {
            "mean": self.proposal.mean,
            "std": self.proposal.std,
            "sums": np.array([self._seen, *astuple(self._sums)]),
        }
        return archive.write("cem", self._Facts(self._rounds), arrays)

    def restore(self, state: bytes) -> None:
        """Go on from there, bit for bit.

        Raises:
            ProtocolError: the bytes are not a state of this method with this horizon.
        """
        facts, arrays = archive.read("cem", state, self._Facts)
        shape = self.proposal.mean.shape
        with archive.refusing("cem"):
            mean, std = (archive.take(arrays, name, shape) for name in ("mean", "std"))
            seen, *sums = archive.take(NO_SUMS | arrays, "sums", (len(BLANK),)).tolist()
        self._rounds = facts.rounds
        self._seen, self._sums = int(seen), WeightedFailures(*sums)
        self.proposal = GaussianProposal(mean, std)

    def _moved(self, mean: archive.Array, std: archive.Array) -> GaussianProposal:
        """The proposal on its way to the elite's mean and standard deviation, within bounds.

        The mean's move is averaged over steps, not the mean: that would be flattened every round.
        """
        given, before = self._settings, self.proposal
        move = averaged(mean - before.mean, given.mean_window)
        mean = before.mean + given.mean_smoothing * move
        std = before.std + given.std_smoothing * (std - before.std)
        return GaussianProposal(
            _within(mean, -given.max_mean, given.max_mean),
            _within(std, given.min_std, given.max_std),
        )


def _within(values: archive.Array, low: float, high: float) -> Floats:
    return np.clip(values, low, high).astype(np.float32)
