"""DiFS as a learner (Delecki et al. 2025): train, lower the threshold, sample, train again."""

from collections.abc import Sequence
from math import exp
from typing import Annotated

import msgspec
import numpy as np

from eigenfail.contracts import MethodTraits, Reference
from eigenfail.plugins import load_class
from eigenfail.values.arrays import Floats
from eigenfail.values.episode import EpisodeResult, PriorSource, TrajectorySource
from eigenfail.values.learning import LearnerContext, Proposal, RoundSizes
from eigenfail_services.methods import archive
from eigenfail_services.methods.difs.modes import Mixture, Rows
from eigenfail_services.methods.difs.settings import (
    SCHEDULES,
    DifsSettings,
    Examples,
    TrialMemory,
    make_plan,
)

MODEL = "eigenfail_services.methods.difs.model:DiffusionModel"
"""Path instead of a class, so that torch is imported only when a learner is made."""

SMALLEST_SCALE_M = 1e-3

GUIDANCE_GAIN = 0.3
SMALLEST_GUIDANCE, LARGEST_GUIDANCE = -0.7, 0.2

HELD_OUT_EVERY = 5

MOST_MODES = 4
"""Number of modes that is searched for until the elites of all modes are failures.

Later searches would split the failures of one mode.
"""

EXPLOITS = 2**32
"""First draw of `exploit`, so that exploitation does not change the draws of learning."""


class DiffusionFailureSampling:
    """Samples p(x | robustness) at low robustness, which decreases from round to round.

    Attributes:
        lookahead: 0, as each round is sampled from a model of all earlier rounds.
    """

    Settings = DifsSettings

    class _Facts(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
        """State besides arrays: counters, threshold and scale of robustness [m], guidance."""

        guidance: float
        proposed: Annotated[int, msgspec.Meta(ge=0)] = 0
        draws: Annotated[int, msgspec.Meta(ge=0)] = 0
        exploits: Annotated[int, msgspec.Meta(ge=0)] = 0
        threshold_m: float | None = None
        scale_m: float = 1.0

    traits = MethodTraits(chart_mark=2, references={"data_from": Reference.EPISODES})
    lookahead = 0

    def __init__(self, context: LearnerContext, settings: DifsSettings) -> None:
        self._settings = settings
        self._seed = context.seed
        self._schedule = SCHEDULES[settings.schedule]
        shape = context.horizon, context.channels
        self._model = load_class(MODEL)(settings, *shape, context.seed)
        self._trials = TrialMemory(*shape, settings.memory)
        self._facts = self._Facts(settings.guidance)
        if context.experience is not None:
            self._trials.add_experience(context.experience)
            self._lower_threshold(self._trials)
        plan = make_plan(context.episodes, settings)
        self._plan = msgspec.structs.replace(plan, initial=max(0, plan.initial - len(self._trials)))

    @staticmethod
    def round_sizes(settings: DifsSettings, episodes: int) -> RoundSizes:
        """Return the sizes of the plan; the samples at robustness 0 are one round."""
        plan = make_plan(episodes, settings)
        return RoundSizes(plan.initial, max(plan.round_size, episodes - plan.final))

    def propose(self, n: int) -> Proposal:
        """Return draws from the prior, later samples below the threshold, at last at 0."""
        proposed, plan = self._facts.proposed, self._plan
        if proposed < plan.initial:
            count = min(n, plan.initial - proposed)
            sources: tuple[PriorSource | TrajectorySource, ...] = (PriorSource(),) * count
        elif proposed < plan.final:
            self._train_on_experience()
            count = min(n, plan.round_size, plan.final - proposed)
            conditions = self._draw_conditions(count)
            mixture, guidance = self._model.mixture, self._facts.guidance
            sources = self._sample(conditions, guidance, self._next_draw(), mixture)
        else:
            self._train_on_experience()
            sources = self._sample_failures(n, self._next_draw())
        self._update_facts(proposed=proposed + len(sources))
        return Proposal(sources)

    def observe(self, results: Sequence[EpisodeResult]) -> None:
        """Keep the trajectories, lower the threshold, and train.

        Raises:
            LearnerDiverged: training diverged.
        """
        fresh = TrialMemory(*self._trials.z.shape[1:], len(results))
        fresh.add(results)
        if not len(fresh):
            return
        # Before the model's first draw all episodes come from the prior, which says nothing of
        # guidance.
        sampled = self._facts.draws > 0
        self._trials.add(results)
        self._lower_threshold(fresh)
        if sampled:
            self._adapt_guidance(float(np.mean(fresh.robustness <= 0.0)))
        # The last part of a plan is sampled from one finished model.
        if self._facts.proposed <= self._plan.final:
            self._train()

    def exploit(self, n: int) -> Proposal:
        """Return samples at robustness 0 from the present model, without learning."""
        self._update_facts(exploits=self._facts.exploits + 1)
        return Proposal(self._sample_failures(n, EXPLOITS + self._facts.exploits))

    def state(self) -> bytes:
        """Return model, optimizer, trajectories, threshold and counters."""
        arrays = {**self._model.arrays(), **self._trials.arrays()}
        return archive.write("difs", self._facts, arrays)

    def restore(self, state: bytes) -> None:
        """Restore a state, from which learning goes on bit for bit.

        Raises:
            ProtocolError: the bytes are not a state of this method with these settings.
        """
        facts, arrays = archive.read("difs", state, self._Facts)
        with archive.wrap_errors("difs"):
            self._model.load(arrays)
            self._trials.load(arrays)
        self._facts = facts

    def _train_on_experience(self) -> None:
        """Train on episodes of earlier campaigns where they replace draws from the prior."""
        if self._facts.draws == 0 and len(self._trials):
            self._train()

    def _train(self) -> None:
        """Fit the mixture, and take gradient steps unless the network is to wait.

        Before the mixture has the modes, the network would move all samples to that mode which
        happens to be nearest to failures.
        """
        plan = self._plan
        settled = self._trials.has_elites(self._settings.elite, self._assign_kinds())
        steps = plan.steps if self._model.trained else plan.first_steps
        taken = steps if settled or not plan.waits else 0
        self._model.train(self._make_examples(), taken, self._next_draw())

    def _lower_threshold(self, fresh: TrialMemory) -> None:
        """Lower the threshold to the quantile of the newest round."""
        reached = fresh.quantile(self._settings.quantile)
        before = self._facts.threshold_m
        if before is None:
            # Fixed by the first round: a condition must mean the same in all trainings.
            scale = max(fresh.quantile(0.5), SMALLEST_SCALE_M)
            self._update_facts(threshold_m=reached, scale_m=scale)
        else:
            self._update_facts(threshold_m=min(before, reached))

    def _adapt_guidance(self, rate: float) -> None:
        """Lower the guidance if more samples fail than the target rate, else raise it.

        So samples are as likely as the target rate allows. It begins when all elites are failures.
        """
        if self._trials.has_elites(self._settings.elite, self._assign_kinds()):
            change = exp(GUIDANCE_GAIN * (self._settings.target_rate - rate))
            # The weight is 1 + w: it is changed by a factor, so that it stays positive.
            moved = (1.0 + self._facts.guidance) * change - 1.0
            most = max(LARGEST_GUIDANCE, self._settings.guidance)
            self._update_facts(guidance=min(max(moved, SMALLEST_GUIDANCE), most))

    def _draw_conditions(self, count: int) -> Floats:
        """Return robustness ÷ scale of samples: uniform up to the threshold, a share of them 0."""
        threshold = max(self._facts.threshold_m or 0.0, 0.0) / self._facts.scale_m
        random = np.random.default_rng([self._seed, self._next_draw()])
        # From −0.1, as in the reference code (sisl/DiFS): a share of all draws asks for failures.
        return np.maximum(random.uniform(-0.1, threshold, count), 0.0).astype(np.float32)

    def _sample_failures(self, n: int, draw: int) -> tuple[TrajectorySource, ...]:
        """Return samples at robustness 0, of the components with failures if there are any."""
        given = self._settings.final_guidance
        guidance = self._facts.guidance if given is None else given
        failed = self._assign_kinds()[self._trials.robustness <= 0.0]
        mixture = self._model.mixture.restrict(np.unique(failed))
        return self._sample(np.zeros(n, np.float32), guidance, draw, mixture)

    def _sample(
        self, conditions: Floats, guidance: float, draw: int, mixture: Mixture
    ) -> tuple[TrajectorySource, ...]:
        samples = self._model.sample(conditions, guidance, draw, mixture)
        return tuple(TrajectorySource(z) for z in samples)

    def _make_examples(self) -> Examples:
        """Return the elite, and for the network the least robust of all besides.

        Failures have the condition 0, however far they lie beyond the border: that is what
        samples at robustness 0 are to be like.
        """
        trials, facts, kinds = self._trials, self._facts, self._assign_kinds()
        elite = self._schedule.select(trials, kinds, facts.threshold_m or 0.0, self._settings)
        rows = np.union1d(elite, trials.select_replay(self._settings.replay))
        distances = np.maximum(trials.robustness, 0.0) - trials.find_offsets(kinds)
        known = len(self._model.mixture.shares)
        return Examples(
            z=trials.z[rows],
            unseen=trials.find_unseen()[rows],
            condition=distances[rows] / np.float32(facts.scale_m),
            # By its number: a trajectory is held out in every training, or in none.
            held_out=rows % HELD_OUT_EVERY == 0,
            elite=np.isin(rows, elite),
            modes=known if trials.has_elites(self._settings.elite, kinds) else MOST_MODES,
        )

    def _assign_kinds(self) -> Rows:
        """Return the likeliest component of each trajectory, shape (n,)."""
        kinds: Rows = self._model.mixture.assign(self._trials.z, self._trials.find_unseen())
        return kinds

    def _next_draw(self) -> int:
        self._update_facts(draws=self._facts.draws + 1)
        return self._facts.draws

    def _update_facts(self, **changes: float) -> None:
        self._facts = msgspec.structs.replace(self._facts, **changes)
