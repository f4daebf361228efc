"""Trainers of the adversary's policy, by name, and their common options."""

from typing import Protocol

import msgspec

from eigenfail.plugins import load_class
from eigenfail.values import STATE, Policy
from eigenfail_services.methods.archive import Arrays
from eigenfail_services.methods.ast.decisions import Decisions

ACTIONS = 2

REWARD_SCALE = 1e-3
"""Scale of rewards: natural rewards (thousands) make the learning of small new networks stall.

With the initial entropy coefficient at the same scale, every target, loss and gradient is the
natural one times a constant, to which Adam is invariant: the algorithm is the same as with natural
rewards and critics whose outputs are multiplied by 1000.
"""

TRAINERS = {
    "fast": "eigenfail_services.methods.ast.trainer_numpy:FastTrainer",
    "sb3": "eigenfail_services.methods.ast.trainer_sb3:SacTrainer",
}
"""Paths instead of classes, so that torch is imported only with the trainer that needs it."""


class SacOptions(msgspec.Struct, frozen=True):
    """Settings of soft actor-critic, by the paper's names.

    Attributes:
        entropy: initial entropy coefficient, at the natural scale of rewards.
        target_entropy: entropy to which the coefficient adapts, of an action in [-1, 1]². [nat]
        hold: number of steps for which one action stays; only written into policies.
        amplitude: largest |z| of the policy. [sigma]
        hidden: widths of the hidden layers of actor and critics.
    """

    learning_rate: float
    batch_size: int
    buffer_size: int
    tau: float
    gamma: float
    hidden: tuple[int, ...]
    entropy: float
    target_entropy: float
    amplitude: float
    hold: int
    seed: int
    states: int = len(STATE)


class Trainer(Protocol):
    """Trains on rollouts of workers; deterministic, given its seed and its transitions."""

    def add(self, decisions: Decisions) -> None:
        """Add transitions to the replay buffer, which drops the oldest ones."""

    def train(self, steps: int, draw: int) -> None:
        """Take gradient steps, with the randomness of draw number `draw`.

        Raises:
            LearnerDiverged: a weight became NaN or infinite.
        """

    def policy(self, version: int) -> Policy:
        """Return the present actor as a policy."""

    def adopt(self, arrays: Arrays) -> None:
        """Take over the networks and the entropy coefficient of another trainer of this kind.

        Optimizers and replay buffer do not change.

        Raises:
            ValueError: an array is missing or has another shape.
        """

    def arrays(self) -> Arrays:
        """Return the whole state, from which training goes on bit for bit."""

    def load(self, arrays: Arrays) -> None:
        """Restore the state.

        Raises:
            ValueError: an array is missing or has another shape.
        """


def make_trainer(name: str, options: SacOptions) -> Trainer:
    """Return a new trainer by its name."""
    trainer: Trainer = load_class(TRAINERS[name])(options)
    return trainer
