"""DiFS as a learner (Delecki et al. 2025): train, lower the threshold, sample, train again."""

from collections.abc import Sequence
from math import prod, sqrt
from typing import Annotated

import msgspec
import numpy as np
from numpy.typing import NDArray

from eigenfail.contracts import MethodTraits, Reference
from eigenfail.plugins import load_class
from eigenfail.values.arrays import Floats
from eigenfail.values.episode import EpisodeResult, PriorSource, TrajectorySource
from eigenfail.values.learning import LearnerContext, Proposal, RoundSizes
from eigenfail_services.methods import archive, trials
from eigenfail_services.methods.batch_learner import limit_round
from eigenfail_services.methods.difs.settings import (
    LARGEST_CONDITION,
    DifsSettings,
    LabelledNoise,
    make_plan,
)
from eigenfail_services.methods.trials import TrialMemory

MODEL = "eigenfail_services.methods.difs.model:ConditionalDiffusion"
"""Path instead of a class, so that torch is imported only when a learner is made."""

SMALLEST_SCALE_M = 1e-3

SMALLEST_ELITE = 20
"""Least size of the elite: the least robust trajectories fill it, also above the threshold."""

EXPLOITS = 2**32
"""First draw of `exploit`, so that exploitation does not change the draws of learning."""

MOVED = "moved."
"""Prefix of the arrays of moved trajectories in a state."""

FEWEST_MOVED = 5
"""Least number of moved trajectories in the elite that together get half of its weight."""

SMALLEST_EXCESS = 1.0
"""Excess that is asked for at first, at least: the standard deviation under p(x)."""

FEWEST_FAILURES = 5
"""Once so many failures are known, their median excess limits the excess of samples. Bolder samples
would lead the search away from likely failures, which the network has yet to learn."""

LARGEST_SQUARE, LARGEST_EXCESS = 4.0, 30.0
"""Limits of the mean z² and of the excess of samples; the higher limit counts. Without a limit, a
search that finds no failures would ask for ever bolder noise. If an episode has few random numbers,
a mean z² of 4 is common under p(x), and the limit of the excess is the higher one."""


def weigh_elite(elite: NDArray[np.bool_], moved: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the chance of each trajectory in the elite's part of a batch, shape (n,).

    Half of it is moved trajectories, if there are enough, before `prefer_likely` changes the
    shares: moved trajectories are spread over all regions of failures. A network that learns from
    its own samples alone keeps ever fewer of the regions.

    Args:
        elite: whether a trajectory is one of the elite, shape (n,).
        moved: whether it was moved, shape (n,).
    """
    own, spread = elite & ~moved, elite & moved
    if np.count_nonzero(spread) < FEWEST_MOVED or not own.any():
        weights: NDArray[np.float64] = elite / np.count_nonzero(elite)
        return weights
    return 0.5 * own / np.count_nonzero(own) + 0.5 * spread / np.count_nonzero(spread)


def prefer_likely(
    elite: NDArray[np.bool_], excess: Floats, preference: float
) -> NDArray[np.float64]:
    """Return a factor for the weight of each trajectory, shape (n,); it falls with the excess.

    It falls from 1 to exp(-preference) over the ranks of the elite, and is 1 for others.

    Args:
        elite: whether a trajectory is one of the elite, shape (n,).
        excess: excess of its squared noise over p(x), shape (n,).
        preference: logarithm of the largest factor ÷ the smallest.
    """
    ranks: NDArray[np.intp] = excess[elite].argsort().argsort()
    factors = np.ones(len(elite))
    factors[elite] = np.exp(-preference * ranks / max(1, len(ranks) - 1))
    return factors


class DiffusionFailureSampling:
    """Samples p(x | robustness) at low robustness, which decreases from round to round.

    The algorithm of Delecki et al. (2025, arXiv 2406.14761) with another network, which has a
    slow mean, and another sampler, which takes few steps. The schedule `paper` has the paper's
    division of the episodes and its training data. `many_rounds` has more and smaller rounds, and
    further changes. A part of each round is drawn from the prior. Batches are half elite and
    half any episodes. The network also knows how unlikely a trajectory is, so that samples can be
    asked to be likely. Some samples are shifted in time and mirrored, which finds more regions of
    failures.

    Attributes:
        lookahead: 0, as each round is sampled from a model of all earlier rounds.
    """

    Settings = DifsSettings

    class _Facts(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
        """State besides arrays.

        Attributes:
            proposed: number of episodes so far.
            draws: number of random draws so far.
            exploits: number of calls of `exploit`.
            threshold_m: robustness at or below which a trajectory is one of the elite; None: no
                round yet. At 0 all failures are elite. [m]
            scale_m: unit of the robustness that the network is given. [m]
            excess: excess that samples are asked to have.
        """

        proposed: Annotated[int, msgspec.Meta(ge=0)] = 0
        draws: Annotated[int, msgspec.Meta(ge=0)] = 0
        exploits: Annotated[int, msgspec.Meta(ge=0)] = 0
        threshold_m: float | None = None
        scale_m: float = 1.0
        excess: float = 0.0

    traits = MethodTraits(chart_mark=2, references={"data_from": Reference.EPISODES})
    lookahead = 0

    def __init__(self, context: LearnerContext, settings: DifsSettings) -> None:
        self._settings = settings
        self._seed = context.seed
        shape = context.horizon, context.channels
        self._plan = make_plan(context.episodes, settings)
        by_square = (LARGEST_SQUARE - 1.0) * sqrt(prod(shape) / 2.0)
        self._largest_excess = max(LARGEST_EXCESS, by_square)
        self._limit = limit_round(context, context.episodes)
        self._model = load_class(MODEL)(settings, *shape, context.seed)
        self._trials = TrialMemory(*shape, settings.memory)
        self._moved = TrialMemory(*shape, settings.memory)
        self._facts = self._Facts()
        if context.experience is not None and len(context.experience.z):
            self._trials.add_experience(context.experience)
            self._lower_threshold(self._trials)
            initial = max(0, self._plan.initial - len(context.experience.z))
            self._plan = msgspec.structs.replace(self._plan, initial=initial)

    @staticmethod
    def round_sizes(settings: DifsSettings, episodes: int) -> RoundSizes:
        """Return the sizes of the plan, whose samples at robustness 0 are one round.

        Noise that does not fit one message comes in smaller rounds.
        """
        plan = make_plan(episodes, settings)
        return RoundSizes(plan.initial, max(plan.round_size, episodes - plan.final))

    def propose(self, n: int) -> Proposal:
        """Return draws from the prior, later samples below the threshold, at last at 0.

        Raises:
            LearnerDiverged: training on earlier campaigns diverged, or a sample is not finite.
        """
        proposed, plan = self._facts.proposed, self._plan
        if proposed < plan.initial:
            return self._count(Proposal((PriorSource(),) * min(n, plan.initial - proposed)))
        if not self._model.trained and len(self._trials):
            self._train()
        n = min(n, self._limit)
        if not self._model.trained:
            return self._count(Proposal((PriorSource(),) * min(n, plan.round_size)))
        if proposed >= plan.final:
            return self._count(self._sample_failures(n, self._draw()))
        return self._count(self._sample_round(min(n, plan.round_size, plan.final - proposed)))

    def observe(self, results: Sequence[EpisodeResult]) -> None:
        """Keep the trajectories, lower the threshold, and train.

        Raises:
            LearnerDiverged: training diverged.
        """
        fresh = TrialMemory(*self._trials.z.shape[1:], len(results))
        fresh.add(results)
        # The last part of a plan is sampled from one finished model.
        finished = self._model.trained and self._facts.proposed > self._plan.final
        if not len(fresh) or finished:
            return
        # Moved samples are the last ones of a proposal.
        moved = 0
        if self._model.trained:
            drawn, moved = self._divide(len(results))
            self._adapt_excess(results[drawn : len(results) - moved])
        self._trials.add(results[: len(results) - moved])
        self._moved.add(results[len(results) - moved :])
        self._lower_threshold(fresh)
        if self._facts.proposed >= self._plan.initial:
            self._train()

    def exploit(self, n: int) -> Proposal:
        """Return samples at robustness 0 from the present network, without learning."""
        self._update_facts(exploits=self._facts.exploits + 1)
        return self._sample_failures(n, EXPLOITS + self._facts.exploits)

    def state(self) -> bytes:
        """Return network, optimizer, trajectories, threshold and counters."""
        moved = {f"{MOVED}{name}": array for name, array in self._moved.arrays().items()}
        arrays = {**self._model.arrays(), **self._trials.arrays(), **moved}
        return archive.write("difs", self._facts, arrays)

    def restore(self, state: bytes) -> None:
        """Restore a state, from which learning goes on bit for bit.

        Raises:
            ProtocolError: the bytes are not a state of this method with these settings.
        """
        facts, arrays = archive.read("difs", state, self._Facts)
        with archive.wrap_errors("difs"):
            self._trials.load(arrays)
            moved = {name for name in arrays if name.startswith(MOVED)}
            self._moved.load({name.removeprefix(MOVED): arrays[name] for name in moved})
            self._model.load(arrays)
        self._facts = facts

    def _count(self, proposal: Proposal) -> Proposal:
        self._update_facts(proposed=self._facts.proposed + len(proposal.sources))
        return proposal

    def _sample_round(self, count: int) -> Proposal:
        """Return draws from the prior, samples below the threshold, and moved samples."""
        drawn, moved = self._divide(count)
        conditions = self._draw_conditions(count - drawn)
        z = self._model.sample(conditions, self._facts.excess, self._draw())
        random = np.random.default_rng([self._seed, self._draw()])
        own = len(z) - moved
        z = np.concatenate([z[:own], trials.move(z[own:], random)])
        return Proposal((PriorSource(),) * drawn + tuple(TrajectorySource(each) for each in z))

    def _sample_failures(self, n: int, draw: int) -> Proposal:
        """Return samples at robustness 0."""
        z = self._model.sample(np.zeros(n, np.float32), self._facts.excess, draw)
        return Proposal(tuple(TrajectorySource(each) for each in z))

    def _divide(self, count: int) -> tuple[int, int]:
        """Return how many episodes of a round are drawn from p(x), and how many samples moved."""
        drawn = round(self._plan.prior_share * count)
        return drawn, round(self._plan.moved_share * (count - drawn))

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

    def _adapt_excess(self, own: Sequence[EpisodeResult]) -> None:
        """Ask for likelier samples after many failures among the network's own, else bolder ones.

        As the 1/5 success rule (Rechenberg 1973) does for a step size: the excess stays the same if
        the target is met, and doubles if no sample failed. A smaller excess than 1 counts as 1.
        """
        failures = [each.is_failure for each in own if each.measures is not None]
        if failures and self._plan.target_rate is not None:
            missed = 1.0 - sum(failures) / len(failures) / self._plan.target_rate
            self._update_facts(excess=max(self._facts.excess, SMALLEST_EXCESS) * 2.0**missed)

    def _choose_excess(self, of_elite: Floats, of_failures: Floats) -> None:
        """Choose the first excess, the median of the elite; keep every excess within its limits.

        Args:
            of_elite: excess of the elite.
            of_failures: excess of the failures so far.
        """
        asked, most = self._facts.excess, self._largest_excess
        if not self._model.trained:
            asked = max(float(np.median(of_elite)), SMALLEST_EXCESS)
        if len(of_failures) >= FEWEST_FAILURES:
            most = min(most, float(np.median(of_failures)))
        self._update_facts(excess=min(asked, most))

    def _draw_conditions(self, count: int) -> Floats:
        """Return robustness ÷ scale of samples: uniform up to the threshold, a share of them 0."""
        # Simulators may give failures a robustness below 0.
        reached = max(self._facts.threshold_m or 0.0, 0.0)
        threshold = min(reached / self._facts.scale_m, LARGEST_CONDITION)
        random = np.random.default_rng([self._seed, self._draw()])
        # From below 0, as in the reference code (sisl/DiFS): some draws ask for failures.
        return np.maximum(random.uniform(-0.1, threshold, count), 0.0).astype(np.float32)

    def _train(self) -> None:
        """Train on the trajectories so far; the first training chooses the excess of samples."""
        both = self._trials, self._moved
        z = np.concatenate([each.z for each in both])
        robustness = np.concatenate([each.robustness for each in both])
        unseen = np.concatenate([each.find_unseen() for each in both])
        elite = self._find_elite(robustness)
        excess = trials.compute_excess(z, unseen)
        weights = weigh_elite(elite, np.arange(len(z)) >= len(self._trials))
        weights *= prefer_likely(elite, excess, self._plan.preference)
        if self._plan.target_rate is None:
            # The network is not told the excess.
            excess = np.zeros_like(excess)
        else:
            self._choose_excess(excess[elite], excess[robustness <= 0.0])
        condition = np.clip(robustness / np.float32(self._facts.scale_m), 0.0, LARGEST_CONDITION)
        examples = LabelledNoise(
            z=z,
            unseen=unseen,
            condition=condition.astype(np.float32),
            excess=excess,
            weights=weights / weights.sum(),
        )
        plan = self._plan
        steps = plan.steps if self._model.trained else plan.first_steps
        self._model.train(examples, steps, plan.elite_share, self._draw())

    def _find_elite(self, robustness: Floats) -> NDArray[np.bool_]:
        """Return which trajectories are at or below the threshold, or among the best."""
        least = np.sort(robustness)[:SMALLEST_ELITE].max(initial=-np.inf)
        limit = max(np.float32(self._facts.threshold_m or 0.0), least)
        elite: NDArray[np.bool_] = robustness <= limit
        return elite

    def _draw(self) -> int:
        """Return the number of the next random draw."""
        self._update_facts(draws=self._facts.draws + 1)
        return self._facts.draws

    def _update_facts(self, **changes: float) -> None:
        self._facts = msgspec.structs.replace(self._facts, **changes)
