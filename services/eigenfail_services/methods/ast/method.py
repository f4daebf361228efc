"""AST as a learner: soft actor-critic on the paper's decision process (Lee et al. 2020)."""

from collections.abc import Sequence
from typing import Annotated, Literal

import msgspec

from eigenfail.values import EpisodeResult, LearnerContext, PolicySource, Proposal
from eigenfail_services.methods import archive
from eigenfail_services.methods.ast.decisions import decisions, usable
from eigenfail_services.methods.ast.reward import PaperReward
from eigenfail_services.methods.ast.trainer import SacOptions, make_trainer

Width = Annotated[int, msgspec.Meta(ge=1, le=4096)]


class AstSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Settings of `ast`, by the paper's names.

    The defaults suit some hundred episodes of twenty decisions. The paper's main runs had far more
    decisions and used alpha 5000, c_dist 1000, tau 0.001, learning_rate 3e-4, batch_size 16,
    buffer_size 10,000. With few decisions each must be used more often and tell more, or the
    critics learn too late what matters at an episode's beginning. The entropy coefficient starts
    near the scale of the rewards: lower, the policy commits itself to the first critics' errors.
    """

    alpha: Annotated[
        float, msgspec.Meta(ge=0.0, le=1e7, description="penalty for an episode without a failure")
    ] = 10_000.0
    c_dist: Annotated[
        float, msgspec.Meta(ge=0.0, le=1e7, description="penalty per metre of robustness left")
    ] = 1000.0
    tau: Annotated[
        float, msgspec.Meta(gt=0.0, le=1.0, description="share by which the target critics follow")
    ] = 0.01
    learning_rate: Annotated[
        float, msgspec.Meta(gt=0.0, le=1.0, description="of actor, critics and entropy coefficient")
    ] = 1e-3
    batch_size: Annotated[
        int, msgspec.Meta(ge=1, le=100_000, description="decisions in a gradient step")
    ] = 64
    buffer_size: Annotated[
        int, msgspec.Meta(ge=1, le=10_000_000, description="decisions that are remembered")
    ] = 10_000
    gamma: Annotated[
        float, msgspec.Meta(ge=0.0, le=1.0, description="discount from decision to decision")
    ] = 0.99
    hidden: Annotated[
        tuple[Width, ...],
        msgspec.Meta(min_length=1, max_length=8, description="widths of the hidden layers"),
    ] = (64, 64)
    entropy: Annotated[
        float, msgspec.Meta(gt=0.0, le=1e6, description="first value of the entropy coefficient")
    ] = 2000.0
    target_entropy: Annotated[
        float, msgspec.Meta(ge=-50.0, le=1.3, description="of an action, held by the coefficient")
    ] = -2.0
    hold: Annotated[
        int, msgspec.Meta(ge=1, le=10_000, description="steps for which one action stays")
    ] = 5
    amplitude: Annotated[
        float, msgspec.Meta(gt=0.0, le=10.0, description="largest |z| of the policy [sigma]")
    ] = 3.0
    round_size: Annotated[
        int, msgspec.Meta(ge=1, le=100_000, description="episodes between two policy versions")
    ] = 10
    warm_up: Annotated[
        int,
        msgspec.Meta(
            ge=0, le=1_000_000, description="episodes before the first training; at most a quarter"
        ),
    ] = 60
    gradient_steps: Annotated[
        int, msgspec.Meta(ge=1, le=1000, description="for each decision observed")
    ] = 10
    trainer: Annotated[
        Literal["fast", "sb3"],
        msgspec.Meta(description="the same soft actor-critic, in numpy or stable-baselines3's"),
    ] = "fast"

    def options(self, seed: int) -> SacOptions:
        """What concerns the trainer alone."""
        return SacOptions(
            learning_rate=self.learning_rate,
            batch_size=self.batch_size,
            buffer_size=self.buffer_size,
            tau=self.tau,
            gamma=self.gamma,
            hidden=self.hidden,
            entropy=self.entropy,
            target_entropy=self.target_entropy,
            amplitude=self.amplitude,
            hold=self.hold,
            seed=seed,
        )


class AdaptiveStressTesting:
    """Learns a policy that disturbs what the planner perceives until it crashes.

    Warm-up episodes come from the untrained policy: near-uniform within the amplitude and held for
    `hold` steps. Draws from the prior would teach nothing: any tracker filters white noise away.

    Attributes:
        lookahead: the next policy is trained while the previous round still runs.
    """

    Settings = AstSettings

    class _Facts(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
        """Counters: the policy's version, the episodes kept, the decisions not yet trained on."""

        version: Annotated[int, msgspec.Meta(ge=0)] = 0
        episodes: Annotated[int, msgspec.Meta(ge=0)] = 0
        fresh: Annotated[int, msgspec.Meta(ge=0)] = 0

    lookahead = 1

    def __init__(self, context: LearnerContext, settings: AstSettings) -> None:
        self._settings = settings
        self._reward = PaperReward(settings.alpha, settings.c_dist)
        self._trainer = make_trainer(settings.trainer, settings.options(context.seed))
        self._warm_up = min(settings.warm_up, context.episodes // 4)
        self._facts = self._Facts()

    def propose(self, n: int) -> Proposal:
        """A round under the newest policy."""
        count = min(n, self._settings.round_size)
        version = self._facts.version
        return Proposal((PolicySource(version),) * count, self._trainer.policy(version))

    def observe(self, results: Sequence[EpisodeResult]) -> None:
        """Learn from the episodes that were run to their end.

        Raises:
            LearnerFailed: training diverged, or an episode holds NaN.
        """
        kept = [self._keep(result) for result in results if usable(result)]
        version, episodes, fresh = msgspec.structs.astuple(self._facts)
        episodes, fresh = episodes + len(kept), fresh + sum(kept)
        if fresh and episodes >= self._warm_up:
            version += 1
            self._trainer.train(fresh * self._settings.gradient_steps, draw=version)
            fresh = 0
        self._facts = self._Facts(version, episodes, fresh)

    def state(self) -> bytes:
        """Networks, targets, optimizers, replay buffer and counters."""
        return archive.write("ast", self._facts, self._trainer.arrays())

    def restore(self, state: bytes) -> None:
        """Go on from there, bit for bit.

        Raises:
            ProtocolError: the bytes are not a state of this method with these settings.
        """
        facts, arrays = archive.read("ast", state, self._Facts)
        with archive.refusing("ast"):
            self._trainer.load(arrays)
        self._facts = facts

    def _keep(self, result: EpisodeResult) -> int:
        found = decisions(result, self._reward, self._settings.hold, self._settings.amplitude)
        self._trainer.add(found)
        return len(found.rewards)
