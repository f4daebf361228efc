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
"""Least size of the elite: the least robust trajectories fill it, also above the threshold."""

FEWEST_MOVED = 5
"""With fewer moved trajectories in the elite, all of the elite have the same weight."""

EXPLOITS = 2**32
"""First draw of `exploit`, so that exploitation does not change the draws of learning."""

MOVED = "moved."
"""Prefix of the arrays of moved trajectories in a state."""


def move(z: Floats, random: np.random.Generator) -> Floats:
    """Shift each trajectory in time, and give each of its channels a random sign.

    A shift is drawn uniformly from all shifts that keep at least one step. Steps without shifted
    noise get new draws. Noise from p(x) stays noise from p(x).

    Args:
        z: shape (n, horizon, channels). [sigma]
        random: generator of shifts, signs and new draws.
    """
    count, horizon, channels = z.shape
    by = random.integers(1 - horizon, horizon, size=(count, 1))
    source = np.arange(horizon) - by
    inside = (source >= 0) & (source < horizon)
    shifted = np.take_along_axis(z, np.clip(source, 0, horizon - 1)[..., None], axis=1)
    fresh = random.standard_normal(z.shape, np.float32)
    signs = random.choice(np.array([-1.0, 1.0], np.float32), size=(count, 1, channels))
    moved: Floats = np.where(inside[..., None], shifted, fresh) * signs
    return moved


def weigh_elite(elite: NDArray[np.bool_], moved: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the chance of each trajectory in the elite half of a batch, shape (n,).

    Half of it is moved trajectories, if there are enough: they are spread over all regions of
    failures. A network that learns from its own samples alone keeps ever fewer of the regions.

    Args:
        elite: whether a trajectory is one of the elite, shape (n,).
        moved: whether it was moved, shape (n,).
    """
    own, spread = elite & ~moved, elite & moved
    if np.count_nonzero(spread) < FEWEST_MOVED or not own.any():
        weights: NDArray[np.float64] = elite / np.count_nonzero(elite)
        return weights
    return 0.5 * own / np.count_nonzero(own) + 0.5 * spread / np.count_nonzero(spread)


class DiffusionSampling:
    """Samples p(x | robustness) at low robustness, which decreases from round to round.

    The algorithm of Delecki et al. (2025, arXiv 2406.14761) with three changes. Batches are half
    elite and half any episodes. The network also knows how unlikely a trajectory is, so that
    samples can be asked to be likely. Some samples are shifted in time and mirrored, which finds
    more regions of failures.

    Attributes:
        lookahead: 0, as each round is sampled from a model of all earlier rounds.
    """

    Settings = DiffusionSettings

    class _Facts(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
        """State besides arrays.

        Attributes:
            draws: number of random draws so far.
            exploits: number of calls of `exploit`.
            threshold_m: robustness at or below which a trajectory is one of the elite; None: no
                round yet. It can fall below 0: then the elite are the severest failures. [m]
            scale_m: unit of the robustness that the network is given. [m]
            excess: excess that samples are asked to have.
        """

        draws: Annotated[int, msgspec.Meta(ge=0)] = 0
        exploits: Annotated[int, msgspec.Meta(ge=0)] = 0
        threshold_m: float | None = None
        scale_m: float = 1.0
        excess: float = 0.0

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
        self._moved = TrialMemory(*shape, settings.memory)
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
        drawn, moved = self._divide(count)
        z = self._model.sample(
            self._draw_conditions(count - drawn), self._facts.excess, self._draw()
        )
        random = np.random.default_rng([self._seed, self._draw()])
        own = len(z) - moved
        z = np.concatenate([z[:own], move(z[own:], random)])
        return Proposal((PriorSource(),) * drawn + tuple(TrajectorySource(each) for each in z))

    def observe(self, results: Sequence[EpisodeResult]) -> None:
        """Keep the trajectories, lower the threshold, and train.

        Raises:
            LearnerDiverged: training diverged.
        """
        fresh = TrialMemory(*self._trials.z.shape[1:], len(results))
        fresh.add(results)
        if not len(fresh):
            return
        # Moved samples are the last ones of a proposal.
        moved = self._divide(len(results))[1] if self._model.trained else 0
        self._trials.add(results[: len(results) - moved])
        self._moved.add(results[len(results) - moved :])
        self._lower_threshold(fresh)
        self._train()

    def exploit(self, n: int) -> Proposal:
        """Return samples at robustness 0 from the present network, without learning."""
        self._update_facts(exploits=self._facts.exploits + 1)
        draw = EXPLOITS + self._facts.exploits
        z = self._model.sample(np.zeros(n, np.float32), self._facts.excess, draw)
        return Proposal(tuple(TrajectorySource(each) for each in z))

    def state(self) -> bytes:
        """Return network, optimizer, trajectories, threshold and counters."""
        moved = {f"{MOVED}{name}": array for name, array in self._moved.arrays().items()}
        arrays = {**self._model.arrays(), **self._trials.arrays(), **moved}
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
            moved = {name for name in arrays if name.startswith(MOVED)}
            self._moved.load({name.removeprefix(MOVED): arrays[name] for name in moved})
        self._facts = facts

    def _divide(self, count: int) -> tuple[int, int]:
        """Return how many episodes of a round are drawn from p(x), and how many samples moved."""
        drawn = round(self._settings.prior_share * count)
        return drawn, round(self._settings.moved_share * (count - drawn))

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
        random = np.random.default_rng([self._seed, self._draw()])
        # From −0.1, as in the reference code (sisl/DiFS): a share of all draws asks for failures.
        return np.maximum(random.uniform(-0.1, threshold, count), 0.0).astype(np.float32)

    def _train(self) -> None:
        """Train on all trajectories, and choose the excess of the next samples.

        Failures have the condition 0, however far they lie beyond the border: that is what
        samples at robustness 0 are to be like.
        """
        both = self._trials, self._moved
        z, robustness = (
            np.concatenate([each.z for each in both]),
            np.concatenate([each.robustness for each in both]),
        )
        unseen = np.concatenate([each.find_unseen() for each in both])
        elite, excess = self._find_elite(robustness), compute_excess(z, unseen)
        condition = np.clip(robustness / np.float32(self._facts.scale_m), 0.0, LARGEST_CONDITION)
        examples = LabelledNoise(
            z=z,
            unseen=unseen,
            condition=condition.astype(np.float32),
            excess=excess,
            weights=weigh_elite(elite, np.arange(len(z)) >= len(self._trials)),
        )
        self._model.train(examples, self._draw())
        wanted = np.quantile(excess[elite], self._settings.excess_quantile)
        self._update_facts(excess=float(wanted))

    def _find_elite(self, robustness: Floats) -> NDArray[np.bool_]:
        """Return which trajectories are at or below the threshold, or among the best."""
        least = np.sort(robustness)[:SMALLEST_ELITE].max(initial=-np.inf)
        elite: NDArray[np.bool_] = robustness <= max(
            np.float32(self._facts.threshold_m or 0.0), least
        )
        return elite

    def _draw(self) -> int:
        """Return the number of the next random draw."""
        self._update_facts(draws=self._facts.draws + 1)
        return self._facts.draws

    def _update_facts(self, **changes: float) -> None:
        self._facts = msgspec.structs.replace(self._facts, **changes)
