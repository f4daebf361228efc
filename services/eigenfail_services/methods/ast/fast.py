"""Soft actor-critic (Haarnoja et al. 2018) in numpy: the same algorithm, many times as fast.

The networks are so small that a framework spends nearly all of its time on bookkeeping. Here the
twin critics are one batched product, and every optimizer is a few operations on one vector.
"""

from math import exp, log, sqrt
from typing import NamedTuple

import msgspec
import numpy as np

from eigenfail.errors import LearnerDiverged
from eigenfail.values import Floats, Layer, Policy
from eigenfail_services.methods.archive import Arrays, take
from eigenfail_services.methods.ast.decisions import Decisions
from eigenfail_services.methods.ast.memory import Memory
from eigenfail_services.methods.ast.network import BETA1, BETA2, EPSILON, Network
from eigenfail_services.methods.ast.trainer import ACTIONS, REWARD_SCALE, SacOptions

LOG_STD_MIN, LOG_STD_MAX = -20.0, 2.0
LOG_SQRT_TWO_PI = np.float32(0.5 * log(2.0 * np.pi))
TINY = np.float32(1e-6)


class Choice(NamedTuple):
    """Actions drawn for a batch of states, and what their slopes need."""

    course: list[Floats]
    eps: Floats
    inside: Floats
    std: Floats
    actions: Floats
    room: Floats
    log_probability: Floats


class FastTrainer:
    """Soft actor-critic with twin critics and a learnt entropy coefficient."""

    def __init__(self, options: SacOptions) -> None:
        random = np.random.default_rng([options.seed, 0])
        self._options = options
        self.actor = Network((options.states, *options.hidden, 2 * ACTIONS), (), random)
        widths = (options.states + ACTIONS, *options.hidden, 1)
        self.critics = Network(widths, (2,), random)
        self.targets = Network(widths, (2,), random)
        self.targets.weights[:] = self.critics.weights
        # Logarithm of the entropy coefficient, with Adam's two moments and step count.
        self.entropy = np.array([log(options.entropy * REWARD_SCALE), 0.0, 0.0, 0.0])
        self.memory = Memory(options.buffer_size, options.states, ACTIONS)

    def add(self, decisions: Decisions) -> None:
        """Keep transitions; the oldest ones make room."""
        scaled = decisions.rewards * np.float32(REWARD_SCALE)
        self.memory.add(msgspec.structs.replace(decisions, rewards=scaled))

    def train(self, steps: int, draw: int) -> None:
        """Take gradient steps.

        Raises:
            LearnerDiverged: a weight became NaN or infinite.
        """
        random, batch = np.random.default_rng([self._options.seed, draw]), self._options.batch_size
        with np.errstate(over="ignore", invalid="ignore"):
            for _ in range(steps):
                rows = random.integers(len(self.memory), size=batch)
                eps = random.standard_normal((2, batch, ACTIONS), np.float32)
                self.step(self.memory.take(rows), eps[0], eps[1])
        parts = (self.actor.weights, self.critics.weights, self.targets.weights, self.entropy)
        if not all(np.isfinite(part).all() for part in parts):
            raise LearnerDiverged(
                "Soft actor-critic diverged: a weight became NaN or infinite.",
                "Lower learning_rate, alpha or c_dist, and start the campaign anew.",
            )

    def step(self, batch: Decisions, eps: Floats, next_eps: Floats) -> None:
        """One gradient step of entropy coefficient, critics and actor, in this order.

        Args:
            batch: of transitions, their rewards scaled.
            eps: standard normal draws for the actions in the states, shape (batch, 2).
            next_eps: the same for the next states.
        """
        coefficient = np.float32(exp(self.entropy[0]))
        choice = self._choose(batch.states, eps)
        self._step_entropy(float(np.mean(choice.log_probability)))
        self._step_critics(batch, self._choose(batch.next_states, next_eps), coefficient)
        self._step_actor(batch.states, choice, coefficient)
        self.targets.follow(self.critics, self._options.tau)

    def policy(self, version: int) -> Policy:
        """The actor as it stands, as raw weights."""
        *hidden, (weight, bias) = (
            (weight.copy(), bias.reshape(-1).copy()) for weight, bias in self.actor.layers
        )
        return Policy(
            version=version,
            hidden=tuple(Layer(*layer) for layer in hidden),
            mean=Layer(weight[:ACTIONS], bias[:ACTIONS]),
            log_std=Layer(weight[ACTIONS:], bias[ACTIONS:]),
            amplitude=self._options.amplitude,
            hold=self._options.hold,
        )

    def adopt(self, arrays: Arrays) -> None:
        """Begin with the networks and the entropy coefficient of another trainer.

        Raises:
            ValueError: an array is missing or has another shape.
        """
        networks = {"actor": self.actor, "critics": self.critics, "targets": self.targets}
        for name, network in networks.items():
            network.weights[:] = take(arrays, f"{name}.weights", network.weights.shape)
        self.entropy[0] = take(arrays, "entropy", self.entropy.shape)[0]

    def arrays(self) -> Arrays:
        """Networks, targets, optimizers, entropy coefficient, replay buffer."""
        return {
            **self.actor.arrays("actor"),
            **self.critics.arrays("critics"),
            **self.targets.arrays("targets"),
            **self.memory.arrays("memory"),
            "entropy": self.entropy,
        }

    def load(self, arrays: Arrays) -> None:
        """Go on from there.

        Raises:
            ValueError: an array is missing or has another shape.
        """
        self.actor.load("actor", arrays)
        self.critics.load("critics", arrays)
        self.targets.load("targets", arrays)
        self.memory.load("memory", arrays)
        self.entropy[:] = take(arrays, "entropy", self.entropy.shape)

    def _choose(self, states: Floats, eps: Floats) -> Choice:
        course = self.actor.forward(states)
        mean, log_std = course[-1][:, :ACTIONS], course[-1][:, ACTIONS:]
        clamped = np.clip(log_std, LOG_STD_MIN, LOG_STD_MAX)
        std = np.exp(clamped)
        actions = np.tanh(mean + std * eps)
        room: Floats = np.float32(1.0) - actions * actions
        density = -0.5 * eps * eps - clamped - LOG_SQRT_TWO_PI - np.log(room + TINY)
        inside = (log_std == clamped).astype(np.float32)
        likelihood: Floats = density.sum(axis=1)
        return Choice(course, eps, inside, std, actions, room, likelihood)

    def _step_entropy(self, log_probability: float) -> None:
        """Raise the coefficient where the policy is less random than it should be."""
        slope = -(log_probability + self._options.target_entropy)
        logarithm, mean, square, steps = self.entropy
        steps += 1.0
        mean += (1.0 - BETA1) * (slope - mean)
        square = BETA2 * square + (1.0 - BETA2) * slope * slope
        size = sqrt(square) / sqrt(1.0 - BETA2**steps) + EPSILON
        change = self._options.learning_rate / (1.0 - BETA1**steps) * mean / size
        self.entropy[:] = logarithm - change, mean, square, steps

    def _step_critics(self, batch: Decisions, then: Choice, coefficient: np.float32) -> None:
        seen = np.concatenate([batch.next_states, then.actions], axis=1)
        later = self.targets.forward(seen)[-1][..., 0].min(axis=0)
        later -= coefficient * then.log_probability
        wanted = batch.rewards + (1.0 - batch.ends) * np.float32(self._options.gamma) * later
        course = self.critics.forward(np.concatenate([batch.states, batch.actions], axis=1))
        slope = (course[-1] - wanted[:, None]) / np.float32(len(wanted))
        self.critics.descend(course, slope, self._options.learning_rate)

    def _step_actor(self, states: Floats, choice: Choice, coefficient: np.float32) -> None:
        """Against the mean of coefficient · log pi - min Q."""
        count = np.float32(len(states))
        course = self.critics.forward(np.concatenate([states, choice.actions], axis=1))
        values = course[-1]
        lesser = values == values.min(axis=0)
        slope = self.critics.slope_in_input(course, -lesser.astype(np.float32) / count)
        sums = slope.sum(axis=0)[:, -ACTIONS:] * choice.room
        sums += coefficient / count * 2.0 * choice.actions * choice.room / (choice.room + TINY)
        widths = (sums * choice.std * choice.eps - coefficient / count) * choice.inside
        self.actor.descend(
            choice.course, np.concatenate([sums, widths], axis=1), self._options.learning_rate
        )
