"""What trains the adversary's policy; named, so that implementations can stand side by side."""

from typing import Protocol

import msgspec

from eigenfail.plugins import load_class
from eigenfail.values import STATE, Policy
from eigenfail_services.methods.archive import Arrays
from eigenfail_services.methods.ast.decisions import Decisions

ACTIONS = 2

REWARD_SCALE = 1e-3
"""Natural rewards (thousands) are out of reach for small fresh networks: learning stalls.

With the entropy coefficient started at the same scale, every target, loss and gradient is the
natural one times a constant, which Adam does not see: the same algorithm as with natural rewards,
and critics whose outputs are multiplied by 1000.
"""

TRAINERS = {
    "fast": "eigenfail_services.methods.ast.fast:FastTrainer",
    "sb3": "eigenfail_services.methods.ast.sb3:SacTrainer",
}
"""Paths, not classes: only the one that is used is imported, and torch with it."""


class SacOptions(msgspec.Struct, frozen=True):
    """Soft actor-critic's own settings, by the paper's names.

    Attributes:
        entropy: first value of the learnt entropy coefficient, at the natural scale of rewards.
        target_entropy: towards which the coefficient is learnt, of an action in [-1, 1]². [nat]
        hold: number of steps for which one action stays; the trainer only writes it into policies.
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
    """Trains on foreign rollouts; deterministic, given its seed and what it was fed."""

    def add(self, decisions: Decisions) -> None:
        """Keep transitions; the oldest ones make room."""

    def train(self, steps: int, draw: int) -> None:
        """Take gradient steps, with the randomness of draw number `draw`.

        Raises:
            LearnerDiverged: a weight became NaN or infinite.
        """

    def policy(self, version: int) -> Policy:
        """The actor as it stands."""

    def adopt(self, arrays: Arrays) -> None:
        """Begin with the networks and the entropy coefficient of another trainer of this kind.

        Optimizers and replay buffer stay as they are.

        Raises:
            ValueError: an array is missing or has another shape.
        """

    def arrays(self) -> Arrays:
        """Everything needed to go on bit for bit."""

    def load(self, arrays: Arrays) -> None:
        """Go on from there.

        Raises:
            ValueError: an array is missing or has another shape.
        """


def make_trainer(name: str, options: SacOptions) -> Trainer:
    """The trainer of that name."""
    trainer: Trainer = load_class(TRAINERS[name])(options)
    return trainer
