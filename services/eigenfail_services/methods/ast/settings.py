"""Settings of `ast`, by the paper's names."""

from math import log
from typing import Annotated, Literal, Protocol

import msgspec
from msgspec import Meta

from eigenfail.errors import InvalidValue
from eigenfail.plugins import load_class
from eigenfail.values.learning import Policy
from eigenfail_services.methods import Amount, Id, UpToOne, UpToTen
from eigenfail_services.methods.archive import Arrays
from eigenfail_services.methods.ast.decisions import DecisionProcess, Decisions

REWARD_SCALE = 1e-3
"""Scale of rewards: natural rewards (thousands) make the learning of small new networks stall.

With the initial entropy coefficient at the same scale, every target, loss and gradient is the
natural one times a constant, to which Adam is invariant: the algorithm is the same as with natural
rewards and critics whose outputs are multiplied by 1000.
"""


Width = Annotated[int, Meta(ge=1, le=4096)]


class AstSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True, kw_only=True):
    """Settings of `ast`, by the paper's names.

    The defaults suit some hundred episodes of ten decisions. They were tuned on `rulebook` and
    `cut_in`; `docs/methods.md` shows their results on other seeds. The reasons below come from the
    tuning trials. Figures were kept for `gradient_steps` and `averaged`:

    - `n_step`, `gamma`: an episode earns nearly its whole reward at its end, and one-step returns
      carry it back too slowly. At `hold` 10, ten decisions are the whole episode. Then target
      critics are never used, `tau` is without effect, and `gamma` discounts only within the sum.
      `buffer_size` takes effect when the buffer is full, after 1,000 episodes of ten decisions.
    - `hold`: 10 steps outlast the misses after which a tracker gives up, and leave half as many
      decisions to learn as 5 steps.
    - `amplitude`: at ±3 sigma, randomly held noise fails in most episodes. Success at ±2 must be
      learnt.
    - `alpha`, `c_dist`: the log p of a failure sums to about -300 in `cut_in`, and to about -4500
      in the paper's training. So a fifteenth of the paper's alpha has about the same weight.
      Smaller values give likelier failures, which transfer worse to other scenarios.
    - `target_entropy`: at -2, a few of a thousand episodes do not fail.
    - `gradient_steps`: over twelve seeds of `cut_in`, one step per decision gave about as many
      failures in 1000 episodes as two steps, and likelier ones.
    - `averaged`, `converged_share`: the last version may have lost a corner of the scenario that
      earlier versions had. So training goes on, and many versions are averaged. Trials on `cut_in`
      had 20 seeds and twelve unseen places. With the worst seed at the worst place, 50 % of the
      episodes failed under the mean of 20 versions, 83 % under the mean of 50, and 93 % under the
      mean of 100. If a training finds failures late (`merge_in`), the mean of 100 includes
      versions that had not learnt yet.
    - `patience`: without restarts, one seed may find a few failures and another seed hundreds.
    - `reward`: `dissimilarity` gives more diverse but somewhat fewer failures.

    The paper's main runs used alpha 5000, c_dist 1000, tau 0.001, learning_rate 3e-4,
    batch_size 16, buffer_size 10,000.
    """

    reward: Annotated[
        Literal["paper", "mahalanobis", "dissimilarity"],
        Meta(description="reward of the adversary"),
    ] = "paper"
    alpha: Annotated[
        float, Meta(ge=0.0, le=1e7, description="penalty for an episode without a failure")
    ] = 300.0
    c_dist: Annotated[
        float, Meta(ge=0.0, le=1e7, description="penalty per metre of robustness left")
    ] = 30.0
    c_dissimilarity: Annotated[
        float,
        Meta(
            ge=0.0,
            le=1e7,
            description="bonus per sigma of distance from earlier failures (dissimilarity)",
        ),
    ] = 100.0
    tau: Annotated[UpToOne, Meta(description="share by which target critics approach critics")] = (
        0.01
    )
    learning_rate: Annotated[
        UpToOne, Meta(description="learning rate of all networks and the entropy")
    ] = 1e-3
    batch_size: Annotated[Amount, Meta(description="decisions in a gradient step")] = 64
    buffer_size: Annotated[
        int, Meta(ge=1, le=10_000_000, description="decisions in the replay buffer")
    ] = 10_000
    gamma: Annotated[
        float, Meta(ge=0.0, le=1.0, description="discount from decision to decision")
    ] = 1.0
    # With `hold` = 10, an episode of 100 steps is ten decisions: the default sums its whole return.
    n_step: Annotated[
        int,
        Meta(ge=1, le=10_000, description="decisions whose rewards are summed"),
    ] = 10
    hidden: Annotated[
        tuple[Width, ...],
        Meta(min_length=1, max_length=8, description="widths of the hidden layers"),
    ] = (64, 64)
    entropy: Annotated[float, Meta(gt=0.0, le=1e6, description="initial entropy coefficient")] = (
        40.0
    )
    target_entropy: Annotated[
        float, Meta(ge=-50.0, le=1.3, description="target entropy of an action [nat]")
    ] = -4.0
    hold: Annotated[int, Meta(ge=1, le=10_000, description="steps for which one action stays")] = 10
    amplitude: Annotated[UpToTen, Meta(description="largest |z| of the policy [sigma]")] = 2.0
    round_size: Annotated[Amount, Meta(description="episodes between two policy versions")] = 10
    # Trials found more failures with 30 than with 60.
    warm_up: Annotated[
        int,
        Meta(
            ge=0, le=1_000_000, description="episodes before the first training; at most a quarter"
        ),
    ] = 30
    gradient_steps: Annotated[
        int, Meta(ge=1, le=1000, description="gradient steps for each observed decision")
    ] = 1
    converged_share: Annotated[
        UpToOne | None,
        Meta(description="share of failures in 100 episodes that ends training; None: no end"),
    ] = None
    averaged: Annotated[
        int,
        Meta(
            ge=1,
            le=10_000,
            description="versions in the running mean of weights that `evaluate` uses; 1: the last",
        ),
    ] = 50
    patience: Annotated[
        Annotated[int, Meta(ge=100, le=1_000_000)] | None,
        Meta(
            description="episodes after which a training that finds next to nothing starts anew, "
            "if as many are left; None: never"
        ),
    ] = 100
    largest_amplitude: Annotated[
        UpToTen,
        Meta(description="largest |z| to which restarts widen `amplitude` [sigma]"),
    ] = 4.0
    warm_start: Annotated[
        Id | None,
        Meta(description="campaign of `ast` whose networks are the initial ones"),
    ] = None

    trainer: Annotated[
        Literal["fast", "sb3"],
        Meta(description="soft actor-critic in numpy (fast) or stable-baselines3"),
    ] = "fast"

    def no_estimate(self) -> str:
        """Return why the failure probability is missing, with a remedy; empty if it exists."""
        if self.hold == 1:
            return ""
        return (
            f"noise that is held for {self.hold} steps has no density under p(z), where every step "
            "is drawn independently. Set hold = 1, or take method subset."
        )

    def reach(self) -> str:
        """Return the largest noise that a policy can choose, and how to exceed it."""
        held = f", held for {self.hold} steps" if self.hold > 1 else ""
        most = f"{self.amplitude:g} sigma{held}{self._describe_widening()}"
        return (
            f"The method explores disturbances of at most {most}; failures beyond are out of its "
            "reach. Raise `amplitude`, or run cem, difs or subset."
        )

    def _describe_widening(self) -> str:
        """Return a clause on the amplitude's growth in restarts; empty without growth."""
        if self.patience is None or self.largest_amplitude <= self.amplitude:
            return ""
        return (
            f", and of up to {self.largest_amplitude:g} sigma in restarts after every "
            f"{self.patience} episodes with next to no failure, where as many are left"
        )

    def process(self) -> DecisionProcess:
        """Return the grouping of steps and decisions."""
        return DecisionProcess(hold=self.hold, n_step=self.n_step, gamma=self.gamma)

    def check_entropy(self, channels: int) -> None:
        """Check that an action with one component per channel can reach the target entropy.

        Raises:
            InvalidValue: the target entropy is too large.
        """
        # Actions lie in [-1, 1]: the uniform distribution over an axis has ln 2, and none has more.
        most = channels * log(2.0)
        if self.target_entropy >= most:
            raise InvalidValue(
                "settings.target_entropy",
                f"{self.target_entropy:g} nat are too many: an action has at most ln 2 for each "
                f"channel, {most:.2f} in all.",
                "Ask for less.",
            )


TRAINERS = {
    "fast": "eigenfail_services.methods.ast.trainer_numpy:FastTrainer",
    "sb3": "eigenfail_services.methods.ast.trainer_sb3:SacTrainer",
}
"""Paths instead of classes, so that torch is imported only with the trainer that needs it."""


class Trainer(Protocol):
    """Trains on rollouts of workers; deterministic for a given seed and transitions."""

    def add(self, decisions: Decisions) -> None:
        """Add transitions to the replay buffer, which drops the oldest ones."""

    def train(self, steps: int, draw: int) -> None:
        """Take gradient steps, with random numbers that depend on `draw`.

        Raises:
            LearnerDiverged: a weight became NaN or infinite.
        """

    def policy(self, version: int) -> Policy:
        """Return the present actor as a policy."""

    def adopt(self, arrays: Arrays) -> None:
        """Copy the networks and the entropy coefficient from another trainer of this kind.

        Optimizers and replay buffer do not change.

        Raises:
            ValueError: an array is missing or has another shape.
        """

    def arrays(self) -> Arrays:
        """Return the whole state, so that training can continue bit for bit."""

    def load(self, arrays: Arrays) -> None:
        """Restore the state.

        Raises:
            ValueError: an array is missing or has another shape.
        """


def make_trainer(settings: AstSettings, channels: int, seed: int) -> Trainer:
    """Return the trainer from the settings, with new networks.

    Args:
        settings: settings of the method.
        channels: number of channels of the noise, each a component of an action.
        seed: seed of the first weights and of all batches.
    """
    trainer: Trainer = load_class(TRAINERS[settings.trainer])(settings, channels, seed)
    return trainer
