"""Failures sampled with a conditional diffusion network, which learns from the first round on."""

from collections.abc import Sequence
from typing import Annotated

import msgspec
import numpy as np
from numpy.typing import NDArray

from eigenfail.contracts import MethodTraits
from eigenfail.values.arrays import Floats
from eigenfail.values.episode import EpisodeResult, PriorSource, TrajectorySource
from eigenfail.values.learning import LearnerContext, Proposal, RoundSizes
from eigenfail_searches.diffusion.settings import (
    LARGEST_CONDITION,
    DiffusionSettings,
    LabelledNoise,
    compute_excess,
)
from eigenfail_services.methods import archive
from eigenfail_services.methods.batch_learner import limit_round
from eigenfail_services.methods.difs.settings import TrialMemory

SMALLEST_SCALE_M = 1e-3

SMALLEST_ELITE = 20
"""Least number of trajectories in the elite: the least robust ones."""

EXPLOITS = 2**32
"""First draw of `exploit`, so that exploitation does not change the draws of learning."""


class DiffusionSampling:
    """Samples p(x | robustness) at low robustness, which decreases from round to round.

    The algorithm of Delecki et al. (2025, arXiv 2406.14761) with two changes: batches are half
    elite and half any episodes, and the network also knows how unlikely a trajectory is, so that
    samples can be asked to be likely.

    Attributes:
        lookahead: 0, as each round is sampled from a model of all earlier rounds.
    """

    Settings = DiffusionSettings

    class _Facts(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
        """State besides arrays: counters, threshold and scale of robustness [m]."""

        draws: Annotated[int, msgspec.Meta(ge=0)] = 0
        exploits: Annotated[int, msgspec.Meta(ge=0)] = 0
        threshold_m: float | None = None
        scale_m: float = 1.0

    traits = MethodTraits(chart_mark=18, references={})
    lookahead = 0

    def __init__(self, context: LearnerContext, settings: DiffusionSettings) -> None:
        # Here, so that torch is imported only when a learner is made.
        from eigenfail_searches.diffusion.model import ConditionalDiffusion

        self._settings = settings
        self._seed = context.seed
        self._round_size = limit_round(context, settings.size_round(context.episodes))
        shape = context.horizon, context.channels
        self._model = ConditionalDiffusion(settings, *shape, context.seed)
        self._trials = TrialMemory(*shape, settings.memory)
        self._facts = self._Facts()

    @staticmethod
    def round_sizes(settings: DiffusionSettings, episodes: int) -> RoundSizes:
        """Return the size of all rounds."""
        size = settings.size_round(episodes)
        return RoundSizes(size, size)

    def propose(self, n: int) -> Proposal:
        """Return draws from the prior, and after a training samples below the threshold."""
        count = min(n, self._round_size)
        if not self._model.trained:
            return Proposal((PriorSource(),) * count)
        drawn = round(self._settings.prior_share * count)
        samples = self._sample(self._draw_conditions(count - drawn), self._next_draw())
        return Proposal((PriorSource(),) * drawn + samples)

    def observe(self, results: Sequence[EpisodeResult]) -> None:
        """Keep the trajectories, lower the threshold, and train.

        Raises:
            LearnerDiverged: training diverged.
        """
        fresh = TrialMemory(*self._trials.z.shape[1:], len(results))
        fresh.add(results)
        if len(fresh):
            self._trials.add(results)
            self._lower_threshold(fresh)
            self._model.train(self._make_examples(), self._next_draw())

    def exploit(self, n: int) -> Proposal:
        """Return samples at robustness 0 from the present network, without learning."""
        self._update_facts(exploits=self._facts.exploits + 1)
        return Proposal(self._sample(np.zeros(n, np.float32), EXPLOITS + self._facts.exploits))

    def state(self) -> bytes:
        """Return network, optimizer, trajectories, threshold and counters."""
        arrays = {**self._model.arrays(), **self._trials.arrays()}
        return archive.write("diffusion", self._facts, arrays)

    def restore(self, state: bytes) -> None:
        """Restore a state, from which learning goes on bit for bit.

        Raises:
            ProtocolError: the bytes are not a state of this method with these settings.
        """
        facts, arrays = archive.read("diffusion", state, self._Facts)
        with archive.wrap_errors("diffusion"):
            self._model.load(arrays)
            self._trials.load(arrays)
        self._facts = facts

    def _lower_threshold(self, fresh: TrialMemory) -> None:
        """Lower the threshold to the quantile of the newest round."""
        reached, before = fresh.quantile(self._settings.quantile), self._facts.threshold_m
        if before is None:
            # Fixed by the first round: a condition must mean the same in all trainings.
            safe = fresh.robustness[fresh.robustness > 0.0]
            scale = float(np.median(safe)) if len(safe) else 1.0
            self._update_facts(threshold_m=reached, scale_m=max(scale, SMALLEST_SCALE_M))
        else:
            self._update_facts(threshold_m=min(before, reached))

    def _draw_conditions(self, count: int) -> Floats:
        """Return robustness ÷ scale of samples: uniform up to the threshold, a share of them 0."""
        threshold = max(self._facts.threshold_m or 0.0, 0.0) / self._facts.scale_m
        random = np.random.default_rng([self._seed, self._next_draw()])
        # From −0.1, as in the reference code (sisl/DiFS): a share of all draws asks for failures.
        return np.maximum(random.uniform(-0.1, threshold, count), 0.0).astype(np.float32)

    def _sample(self, conditions: Floats, draw: int) -> tuple[TrajectorySource, ...]:
        samples = self._model.sample(conditions, self._choose_excess(), draw)
        return tuple(TrajectorySource(z) for z in samples)

    def _choose_excess(self) -> float:
        """Return the excess that samples are asked to have; 0 without trajectories."""
        trials, elite = self._trials, self._find_elite()
        if not len(elite):
            return 0.0
        excess = compute_excess(trials.z[elite], trials.find_unseen()[elite])
        return float(np.quantile(excess, self._settings.excess_quantile))

    def _find_elite(self) -> NDArray[np.intp]:
        """Return the numbers of the trajectories at or below the threshold, at least the best."""
        robustness = self._trials.robustness
        least = np.sort(robustness)[:SMALLEST_ELITE].max(initial=-np.inf)
        limit = max(np.float32(self._facts.threshold_m or 0.0), least)
        return np.flatnonzero(robustness <= limit)

    def _make_examples(self) -> LabelledNoise:
        """Return all trajectories as training data.

        Failures have the condition 0, however far they lie beyond the border: that is what
        samples at robustness 0 are to be like.
        """
        trials, unseen = self._trials, self._trials.find_unseen()
        return LabelledNoise(
            z=trials.z,
            unseen=unseen,
            condition=np.clip(
                trials.robustness / np.float32(self._facts.scale_m), 0.0, LARGEST_CONDITION
            ).astype(np.float32),
            excess=compute_excess(trials.z, unseen),
            elite=self._find_elite(),
        )

    def _next_draw(self) -> int:
        self._update_facts(draws=self._facts.draws + 1)
        return self._facts.draws

    def _update_facts(self, **changes: float) -> None:
        self._facts = msgspec.structs.replace(self._facts, **changes)
