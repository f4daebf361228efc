"""DiFS as a learner (Delecki et al. 2025): train, lower the threshold, sample, train again."""

from collections.abc import Sequence
from math import exp
from typing import Annotated

import msgspec
import numpy as np

from eigenfail.plugins import load_class
from eigenfail.values import (
    EpisodeResult,
    Floats,
    LearnerContext,
    PriorSource,
    Proposal,
    RoundSizes,
    TrajectorySource,
)
from eigenfail_services.methods import archive
from eigenfail_services.methods.difs.mixture import Mixture, Rows
from eigenfail_services.methods.difs.options import Examples
from eigenfail_services.methods.difs.schedules import SCHEDULES, planned
from eigenfail_services.methods.difs.settings import DifsSettings
from eigenfail_services.methods.difs.trials import Trials

MODEL = "eigenfail_services.methods.difs.model:DiffusionModel"
"""A path, not a class: torch is imported once a learner is made."""

SMALLEST_SCALE_M = 1e-3

GUIDANCE_GAIN = 0.3
SMALLEST_GUIDANCE, LARGEST_GUIDANCE = -0.7, 0.2

HELD_OUT_EVERY = 5

MOST_MODES = 4
"""Sought until each mode's elite are failures: later, one mode's failures would be taken apart."""

EXPLOITS = 2**32
"""Draws from here on are those of `exploit`: learning goes on as if there had been none."""


class DiffusionFailureSampling:
    """Samples p(x | robustness) where robustness is low, and lower with every round.

    Attributes:
        lookahead: none: each round is sampled from a model of all before it.
    """

    Settings = DifsSettings

    class _Facts(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
        """Counters, threshold and scale of the robustness [m], weight of the condition."""

        guidance: float
        proposed: Annotated[int, msgspec.Meta(ge=0)] = 0
        draws: Annotated[int, msgspec.Meta(ge=0)] = 0
        exploits: Annotated[int, msgspec.Meta(ge=0)] = 0
        threshold_m: float | None = None
        scale_m: float = 1.0

    lookahead = 0

    def __init__(self, context: LearnerContext, settings: DifsSettings) -> None:
        self._settings = settings
        self._seed = context.seed
        self._schedule = SCHEDULES[settings.schedule]
        self._model = load_class(MODEL)(settings.options(context.horizon, context.seed))
        self._trials = Trials(context.horizon, settings.memory)
        self._facts = self._Facts(settings.guidance)
        if context.experience is not None:
            self._trials.recall(context.experience)
            self._lower(self._trials)
        plan = planned(context.episodes, settings)
        self._plan = msgspec.structs.replace(plan, initial=max(0, plan.initial - len(self._trials)))

    @staticmethod
    def round_sizes(settings: DifsSettings, episodes: int) -> RoundSizes:
        """As planned; what is sampled at robustness 0 in the end is one round."""
        plan = planned(episodes, settings)
        return RoundSizes(plan.initial, max(plan.round_size, episodes - plan.final))

    def propose(self, n: int) -> Proposal:
        """Draws from the prior at first, samples below the threshold then, at 0 in the end."""
        proposed, plan = self._facts.proposed, self._plan
        if proposed < plan.initial:
            count = min(n, plan.initial - proposed)
            sources: tuple[PriorSource | TrajectorySource, ...] = (PriorSource(),) * count
        elif proposed < plan.final:
            self._begin()
            count = min(n, plan.round_size, plan.final - proposed)
            conditions = self._conditions(count)
            mixture, guidance = self._model.mixture, self._facts.guidance
            sources = self._sampled(conditions, guidance, self._next_draw(), mixture)
        else:
            self._begin()
            sources = self._at_zero(n, self._next_draw())
        self._note(proposed=proposed + len(sources))
        return Proposal(sources)

    def observe(self, results: Sequence[EpisodeResult]) -> None:
        """Keep the trajectories, lower the threshold, train.

        Raises:
            LearnerDiverged: training diverged.
        """
        fresh = Trials(self._trials.z.shape[1], len(results))
        fresh.add(results)
        if not len(fresh):
            return
        sampled = self._facts.draws > 0
        self._trials.add(results)
        self._lower(fresh)
        if sampled:
            self._steer(float(np.mean(fresh.robustness <= 0.0)))
        if self._facts.proposed <= self._plan.final:
            self._train()

    def exploit(self, n: int) -> Proposal:
        """Samples at robustness 0 from what is known now; nothing is learnt from them."""
        self._note(exploits=self._facts.exploits + 1)
        return Proposal(self._at_zero(n, EXPLOITS + self._facts.exploits))

    def state(self) -> bytes:
        """Model, optimizer, trajectories, threshold and counters."""
        trials = self._trials
        arrays: dict[str, archive.Array] = {
            "z": trials.z,
            "steps": trials.steps,
            "robustness": trials.robustness,
        }
        return archive.write("difs", self._facts, {**self._model.arrays(), **arrays})

    def restore(self, state: bytes) -> None:
        """Go on from there, bit for bit.

        Raises:
            ProtocolError: the bytes are not a state of this method with these settings.
        """
        facts, arrays = archive.read("difs", state, self._Facts)
        with archive.refusing("difs"):
            count = len(arrays["robustness"])
            z = archive.take(arrays, "z", (count, *self._trials.z.shape[1:]))
            steps = archive.take(arrays, "steps", (count,))
            self._model.load(arrays)
        self._trials.z, self._trials.steps = z, steps
        self._trials.robustness = arrays["robustness"]
        self._facts = facts

    def _begin(self) -> None:
        """Where nothing was drawn from the prior, what earlier campaigns saw is learnt first."""
        if self._facts.draws == 0 and len(self._trials):
            self._train()

    def _train(self) -> None:
        first = self._facts.draws == 0
        steps = self._settings.first_steps if first else self._settings.steps
        self._model.train(self._examples(), steps, self._next_draw())

    def _lower(self, fresh: Trials) -> None:
        """The threshold follows the newest round's quantile, downwards only."""
        reached = fresh.quantile(self._settings.quantile)
        before = self._facts.threshold_m
        if before is None:
            scale = max(fresh.quantile(0.5), SMALLEST_SCALE_M)
            self._note(threshold_m=reached, scale_m=scale)
        else:
            self._note(threshold_m=min(before, reached))

    def _steer(self, rate: float) -> None:
        """Once each kind's elite are failures: guidance down where more fail than need to, else up.

        The samples stay as likely as the failure rate aimed at allows.
        """
        if self._trials.settled(self._settings.elite, self._kinds()):
            change = exp(GUIDANCE_GAIN * (self._settings.target_rate - rate))
            moved = (1.0 + self._facts.guidance) * change - 1.0
            most = max(LARGEST_GUIDANCE, self._settings.guidance)
            self._note(guidance=min(max(moved, SMALLEST_GUIDANCE), most))

    def _conditions(self, count: int) -> Floats:
        """Robustness ÷ scale to ask for: uniform up to the threshold, a share of it at 0."""
        threshold = (self._facts.threshold_m or 0.0) / self._facts.scale_m
        random = np.random.default_rng([self._seed, self._next_draw()])
        return np.maximum(random.uniform(-0.1, threshold, count), 0.0).astype(np.float32)

    def _at_zero(self, n: int, draw: int) -> tuple[TrajectorySource, ...]:
        """Of the components that have failed, once there are failures."""
        given = self._settings.final_guidance
        guidance = self._facts.guidance if given is None else given
        failed = self._kinds()[self._trials.robustness <= 0.0]
        mixture = self._model.mixture.among(np.unique(failed))
        return self._sampled(np.zeros(n, np.float32), guidance, draw, mixture)

    def _sampled(
        self, conditions: Floats, guidance: float, draw: int, mixture: Mixture
    ) -> tuple[TrajectorySource, ...]:
        samples = self._model.sample(conditions, guidance, draw, mixture)
        return tuple(TrajectorySource(z) for z in samples)

    def _examples(self) -> Examples:
        trials, facts, kinds = self._trials, self._facts, self._kinds()
        rows = self._schedule.chosen(trials, kinds, facts.threshold_m or 0.0, self._settings)
        robustness = trials.robustness - trials.behind(kinds)
        known = len(self._model.mixture.shares)
        return Examples(
            z=trials.z[rows],
            unseen=trials.unseen()[rows],
            condition=robustness[rows] / np.float32(facts.scale_m),
            held_out=rows % HELD_OUT_EVERY == 0,
            modes=known if trials.settled(self._settings.elite, kinds) else MOST_MODES,
        )

    def _kinds(self) -> Rows:
        """The component of the mixture that each trajectory is most likely of, shape (n,)."""
        kinds: Rows = self._model.mixture.components(self._trials.z, self._trials.unseen())
        return kinds

    def _next_draw(self) -> int:
        self._note(draws=self._facts.draws + 1)
        return self._facts.draws

    def _note(self, **changes: float) -> None:
        self._facts = msgspec.structs.replace(self._facts, **changes)
