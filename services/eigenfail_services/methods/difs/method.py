"""DiFS as a learner (Delecki et al. 2025): train, lower the threshold, sample, train again."""

from collections.abc import Sequence
from typing import Annotated, Literal

import msgspec
import numpy as np

from eigenfail.plugins import load_class
from eigenfail.values import (
    EpisodeResult,
    Floats,
    LearnerContext,
    PriorSource,
    Proposal,
    TrajectorySource,
)
from eigenfail_services.methods import archive
from eigenfail_services.methods.difs.options import DiffusionOptions, Examples
from eigenfail_services.methods.difs.trials import SMALLEST_SCALE_M, Trials

MODEL = "eigenfail_services.methods.difs.model:DiffusionModel"
"""A path, not a class: torch is imported once a learner is made."""

Share = Annotated[float, msgspec.Meta(ge=0.0, le=1.0)]


class DifsSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Settings of `difs`."""

    initial_share: Annotated[
        Share, msgspec.Meta(description="share of the episodes drawn from the prior at the start")
    ] = 0.4
    final_share: Annotated[
        Share, msgspec.Meta(description="share of the episodes sampled at robustness 0 at the end")
    ] = 0.2
    round_size: Annotated[
        int, msgspec.Meta(ge=1, le=100_000, description="episodes between two trainings")
    ] = 50
    quantile: Annotated[
        float,
        msgspec.Meta(gt=0.0, lt=1.0, description="share of the least robust that is aimed at"),
    ] = 0.3
    first_steps: Annotated[
        int, msgspec.Meta(ge=1, le=1_000_000, description="gradient steps of the first training")
    ] = 1500
    steps: Annotated[
        int, msgspec.Meta(ge=1, le=1_000_000, description="gradient steps of each later training")
    ] = 500
    guidance: Annotated[
        float, msgspec.Meta(ge=0.0, le=10.0, description="weight of the condition in the rounds")
    ] = 0.3
    final_guidance: Annotated[
        float, msgspec.Meta(ge=0.0, le=10.0, description="weight of the condition at the end")
    ] = 0.5
    shrink: Annotated[
        float, msgspec.Meta(gt=0.0, le=1.0, description="how far samples may leave the prior")
    ] = 0.8
    width: Annotated[
        int, msgspec.Meta(ge=1, le=4096, description="of the denoiser's hidden layers")
    ] = 64
    learning_rate: Annotated[float, msgspec.Meta(gt=0.0, le=1.0, description="of AdamW")] = 1e-3
    weight_decay: Annotated[float, msgspec.Meta(ge=0.0, le=1.0, description="of AdamW")] = 1e-5
    batch_size: Annotated[
        int, msgspec.Meta(ge=1, le=100_000, description="trajectories in a gradient step")
    ] = 64
    ema: Annotated[
        float, msgspec.Meta(ge=0.0, lt=1.0, description="decay of the averaged weights")
    ] = 0.995
    dropout: Annotated[
        Share, msgspec.Meta(description="how often training hides the condition, for guidance")
    ] = 0.15
    sampling_steps: Annotated[
        int, msgspec.Meta(ge=1, le=10_000, description="steps of the sampler")
    ] = 20
    memory: Annotated[
        int, msgspec.Meta(ge=10, le=1_000_000, description="trajectories that are remembered")
    ] = 10_000
    device: Annotated[
        Literal["auto", "cpu", "cuda"], msgspec.Meta(description="auto: cuda where there is one")
    ] = "auto"

    def options(self, horizon: int, seed: int) -> DiffusionOptions:
        """What concerns the model alone."""
        return DiffusionOptions(
            horizon=horizon,
            width=self.width,
            learning_rate=self.learning_rate,
            weight_decay=self.weight_decay,
            batch_size=self.batch_size,
            ema=self.ema,
            dropout=self.dropout,
            sampling_steps=self.sampling_steps,
            shrink=self.shrink,
            device=self.device,
            seed=seed,
        )


class DiffusionFailureSampling:
    """Samples p(x | robustness) where robustness is low, and lower with every round.

    Attributes:
        lookahead: none: each round is sampled from a model of all before it.
    """

    Settings = DifsSettings

    class _Facts(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
        """Counters, threshold and scale of the robustness [m]."""

        proposed: Annotated[int, msgspec.Meta(ge=0)] = 0
        draws: Annotated[int, msgspec.Meta(ge=0)] = 0
        threshold_m: float | None = None
        scale_m: float = 1.0

    lookahead = 0

    def __init__(self, context: LearnerContext, settings: DifsSettings) -> None:
        self._settings = settings
        self._seed = context.seed
        self._model = load_class(MODEL)(settings.options(context.horizon, context.seed))
        self._trials = Trials(context.horizon, settings.memory)
        self._initial = max(1, round(settings.initial_share * context.episodes))
        self._budget = context.episodes
        self._final = context.episodes - round(settings.final_share * context.episodes)
        self._facts = self._Facts()

    def propose(self, n: int) -> Proposal:
        """Draws from the prior at first, samples below the threshold then, at 0 in the end."""
        proposed = self._facts.proposed
        if proposed < self._initial:
            count = min(n, self._initial - proposed)
            sources: tuple[PriorSource | TrajectorySource, ...] = (PriorSource(),) * count
        elif proposed < self._final:
            count = min(n, self._settings.round_size, self._final - proposed)
            sources = self._sampled(self._conditions(count), self._settings.guidance)
        else:
            sources = self._sampled(np.zeros(n, np.float32), self._settings.final_guidance)
        self._note(proposed=proposed + len(sources))
        return Proposal(sources)

    def observe(self, results: Sequence[EpisodeResult]) -> None:
        """Keep the trajectories, lower the threshold, train.

        Raises:
            LearnerFailed: training diverged.
        """
        fresh = Trials(self._trials.z.shape[1], len(results))
        fresh.add(results)
        self._trials.add(results)
        if len(fresh):
            self._lower(fresh)
        if len(self._trials) and self._facts.proposed < self._budget:
            first = self._facts.draws == 0
            steps = self._settings.first_steps if first else self._settings.steps
            self._model.train(self._examples(), steps, self._next_draw())

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

    def _lower(self, fresh: Trials) -> None:
        """The threshold follows the newest round's quantile, downwards only."""
        reached = fresh.quantile(self._settings.quantile)
        before = self._facts.threshold_m
        if before is None:
            scale = max(fresh.quantile(0.5), SMALLEST_SCALE_M)
            self._note(threshold_m=reached, scale_m=scale)
        else:
            self._note(threshold_m=min(before, reached))

    def _conditions(self, count: int) -> Floats:
        """Robustness ÷ scale to ask for: uniform up to the threshold, a share of it at 0."""
        threshold = (self._facts.threshold_m or 0.0) / self._facts.scale_m
        random = np.random.default_rng([self._seed, self._next_draw()])
        return np.maximum(random.uniform(-0.1, threshold, count), 0.0).astype(np.float32)

    def _sampled(self, conditions: Floats, guidance: float) -> tuple[TrajectorySource, ...]:
        samples = self._model.sample(conditions, guidance, self._next_draw())
        return tuple(TrajectorySource(z) for z in samples)

    def _examples(self) -> Examples:
        trials, facts = self._trials, self._facts
        count = len(trials)
        unseen = np.broadcast_to(trials.unseen(), trials.z.shape)
        return Examples(
            z=trials.z.reshape(count, -1),
            unseen=unseen.reshape(count, -1).astype(np.float32),
            condition=trials.robustness / np.float32(facts.scale_m),
            weights=trials.weights(facts.threshold_m or 0.0, facts.scale_m),
        )

    def _next_draw(self) -> int:
        self._note(draws=self._facts.draws + 1)
        return self._facts.draws

    def _note(self, **changes: float) -> None:
        self._facts = msgspec.structs.replace(self._facts, **changes)
