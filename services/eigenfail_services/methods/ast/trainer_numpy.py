"""Soft actor-critic (Haarnoja et al. 2018) in numpy: the same algorithm, but many times faster.

The networks are so small that a framework spends nearly all its time on bookkeeping. Here the twin
critics are one batched product, and each optimizer is a few operations on one vector.
"""

from itertools import pairwise
from math import exp, log, prod, sqrt
from typing import NamedTuple

import msgspec
import numpy as np
from numpy.typing import NDArray

from eigenfail.errors import LearnerDiverged
from eigenfail.values.arrays import Floats
from eigenfail.values.learning import Layer, Policy, count_state
from eigenfail_services.methods.archive import Array, Arrays, take
from eigenfail_services.methods.ast.decisions import Decisions
from eigenfail_services.methods.ast.settings import REWARD_SCALE, AstSettings

# Weight of shape (…, outputs, inputs) and bias of shape (…, 1, outputs), views of one vector.
NetworkLayer = tuple[Floats, Floats]

BETA1, BETA2, EPSILON = 0.9, 0.999, 1e-8


class Network:
    """Affine layers with a ReLU between them, and Adam (Kingma and Ba 2015).

    Args:
        widths: widths of input, hidden layers and output.
        copies: shape of the batch of equal networks, () for a single one.
        random: generator of the initial weights, uniform within ±1 / sqrt(inputs) like torch.
    """

    def __init__(
        self, widths: tuple[int, ...], copies: tuple[int, ...], random: np.random.Generator
    ) -> None:
        shapes = [
            shape for n, m in pairwise(widths) for shape in ((*copies, m, n), (*copies, 1, m))
        ]
        size = sum(prod(shape) for shape in shapes)
        self.weights = np.zeros(size, np.float32)
        self._gradient = np.zeros(size, np.float32)
        self._mean = np.zeros(size, np.float32)
        self._square = np.zeros(size, np.float32)
        self._steps = 0
        self.layers = _layers(self.weights, shapes)
        self._gradients = _layers(self._gradient, shapes)
        for weight, bias in self.layers:
            bound = 1.0 / sqrt(weight.shape[-1])
            weight[...] = random.uniform(-bound, bound, weight.shape)
            bias[...] = random.uniform(-bound, bound, bias.shape)

    def forward(self, x: Floats) -> list[Floats]:
        """Return the input of each layer, followed by the output, shape (…, batch, outputs)."""
        course = [x]
        for weight, bias in self.layers[:-1]:
            hidden = course[-1] @ weight.swapaxes(-1, -2)
            hidden += bias
            course.append(np.maximum(hidden, 0.0, out=hidden))
        weight, bias = self.layers[-1]
        course.append(course[-1] @ weight.swapaxes(-1, -2) + bias)
        return course

    def compute_input_gradient(self, course: list[Floats], slope: Floats) -> Floats:
        """Return the gradient of the loss with respect to the input, without changing weights.

        Args:
            course: result of `forward`.
            slope: gradient with respect to the output, shape (…, batch, outputs); the result has
                shape (…, batch, inputs).
        """
        lowest: Floats = self._slopes(course, slope)[-1] @ self.layers[0][0]
        return lowest

    def descend(self, course: list[Floats], slope: Floats, learning_rate: float) -> None:
        """Take one step of Adam.

        Args:
            course: result of `forward`.
            slope: gradient of the loss with respect to the output, shape (…, batch, outputs).
            learning_rate: learning rate of the step.
        """
        slopes = self._slopes(course, slope)[::-1]
        # The gradients are views of one vector: filling them fills what Adam reads.
        for inputs, up, (weight, bias) in zip(course, slopes, self._gradients, strict=False):
            np.matmul(up.swapaxes(-1, -2), inputs, out=weight)
            np.sum(up, axis=-2, keepdims=True, out=bias)
        self._adam(learning_rate)

    def follow(self, leader: "Network", share: float) -> None:
        """Move the weights towards another network's weights by a share of the distance."""
        self.weights += np.float32(share) * (leader.weights - self.weights)

    def arrays(self, prefix: str) -> dict[str, NDArray[np.generic]]:
        """Return weights, moments and step count by name."""
        return {
            f"{prefix}.weights": self.weights,
            f"{prefix}.mean": self._mean,
            f"{prefix}.square": self._square,
            f"{prefix}.steps": np.array([self._steps], np.int64),
        }

    def load(self, prefix: str, arrays: Arrays) -> None:
        """Restore the state.

        Raises:
            ValueError: an array is missing or has another shape.
        """
        self._steps = int(take(arrays, f"{prefix}.steps", (1,))[0])
        for name, own in (
            ("weights", self.weights),
            ("mean", self._mean),
            ("square", self._square),
        ):
            own[...] = take(arrays, f"{prefix}.{name}", own.shape)

    def _slopes(self, course: list[Floats], slope: Floats) -> list[Floats]:
        """Return the gradients with respect to the layers' sums, last layer first."""
        slopes = [slope]
        for (weight, _), inputs in zip(self.layers[:0:-1], course[-2:0:-1], strict=True):
            below = slopes[-1] @ weight
            below *= inputs > 0.0
            slopes.append(below)
        return slopes

    def _adam(self, learning_rate: float) -> None:
        self._steps += 1
        gradient, mean, square = self._gradient, self._mean, self._square
        # In place: these are other names of the network's own arrays.
        mean += np.float32(1.0 - BETA1) * (gradient - mean)
        square *= np.float32(BETA2)
        square += np.float32(1.0 - BETA2) * gradient * gradient
        size = np.sqrt(square) / np.float32(sqrt(1.0 - BETA2**self._steps)) + np.float32(EPSILON)
        self.weights -= np.float32(learning_rate / (1.0 - BETA1**self._steps)) * mean / size


def _layers(vector: Floats, shapes: list[tuple[int, ...]]) -> list[NetworkLayer]:
    """Return views of a vector: weight and bias of each layer."""
    ends = np.cumsum([prod(shape) for shape in shapes])
    parts = [
        vector[end - prod(shape) : end].reshape(shape)
        for end, shape in zip(ends, shapes, strict=True)
    ]
    return list(zip(parts[::2], parts[1::2], strict=True))


KEPT = ("states", "actions", "rewards", "next_states", "ends")


class TransitionBuffer:
    """Replay buffer: a ring of transitions.

    Args:
        size: number of transitions; the oldest ones are overwritten.
        states: number of a state's components.
        actions: number of an action's components.
    """

    def __init__(self, size: int, states: int, actions: int) -> None:
        widths = {"states": (states,), "next_states": (states,), "actions": (actions,)}
        self._rings = {name: np.zeros((size, *widths.get(name, ())), np.float32) for name in KEPT}
        self._size = size
        self._added = 0

    def __len__(self) -> int:
        return min(self._added, self._size)

    def add(self, decisions: Decisions) -> None:
        """Add transitions."""
        count = len(decisions.rewards)
        places = np.arange(self._added, self._added + count) % self._size
        for name, ring in self._rings.items():
            ring[places] = getattr(decisions, name)
        self._added += count

    def select_rows(self, rows: Array) -> Decisions:
        """Return the transitions of some rows."""
        picked: dict[str, Floats] = {name: ring[rows] for name, ring in self._rings.items()}
        return Decisions(**picked)

    def arrays(self, prefix: str) -> dict[str, Array]:
        """Return the transitions as arrays by name."""
        kept = {f"{prefix}.{name}": ring[: len(self)] for name, ring in self._rings.items()}
        return {**kept, f"{prefix}.added": np.array([self._added], np.int64)}

    def load(self, prefix: str, arrays: Arrays) -> None:
        """Restore the state.

        Raises:
            ValueError: an array is missing or has another shape.
        """
        self._added = int(take(arrays, f"{prefix}.added", (1,))[0])
        for name, ring in self._rings.items():
            shape = (len(self), *ring.shape[1:])
            ring[: len(self)] = take(arrays, f"{prefix}.{name}", shape)


LOG_STD_MIN, LOG_STD_MAX = -20.0, 2.0
LOG_SQRT_TWO_PI = np.float32(0.5 * log(2.0 * np.pi))
TINY = np.float32(1e-6)


class DrawnActions(NamedTuple):
    """Actions drawn for a batch of states, with the values that their gradients need."""

    course: list[Floats]
    eps: Floats
    inside: Floats
    std: Floats
    actions: Floats
    room: Floats
    log_probability: Floats


class FastTrainer:
    """Soft actor-critic with twin critics and an adaptive entropy coefficient.

    It is deterministic for a given seed and transitions.

    Args:
        settings: settings of the method.
        channels: number of channels of the noise, each a component of an action.
        seed: seed of the first weights and of all batches.
    """

    def __init__(self, settings: AstSettings, channels: int, seed: int) -> None:
        random = np.random.default_rng([seed, 0])
        self._settings = settings
        self._seed = seed
        self._actions = channels
        # For the trainer `n_step` decisions are one.
        self._gamma = settings.gamma**settings.n_step
        states = count_state(channels)
        self.actor = Network((states, *settings.hidden, 2 * channels), (), random)
        widths = (states + channels, *settings.hidden, 1)
        self.critics = Network(widths, (2,), random)
        self.targets = Network(widths, (2,), random)
        # Its own draw is dropped: targets start as copies, as in SB3.
        self.targets.weights[:] = self.critics.weights
        # Logarithm of the entropy coefficient, with Adam's two moments and step count.
        self.entropy = np.array([log(settings.entropy * REWARD_SCALE), 0.0, 0.0, 0.0])
        self.memory = TransitionBuffer(settings.buffer_size, states, channels)

    def add(self, decisions: Decisions) -> None:
        """Store transitions; the oldest ones are overwritten."""
        scaled = decisions.rewards * np.float32(REWARD_SCALE)
        self.memory.add(msgspec.structs.replace(decisions, rewards=scaled))

    def train(self, steps: int, draw: int) -> None:
        """Take gradient steps.

        Raises:
            LearnerDiverged: a weight became NaN or infinite.
        """
        random, batch = np.random.default_rng([self._seed, draw]), self._settings.batch_size
        # A diverging run is found below, by its weights: warnings would come by the thousand.
        with np.errstate(over="ignore", invalid="ignore"):
            for _ in range(steps):
                rows = random.integers(len(self.memory), size=batch)
                eps = random.standard_normal((2, batch, self._actions), np.float32)
                self.step(self.memory.select_rows(rows), eps[0], eps[1])
        parts = (self.actor.weights, self.critics.weights, self.targets.weights, self.entropy)
        if not all(np.isfinite(part).all() for part in parts):
            raise LearnerDiverged(
                "Soft actor-critic diverged: a weight became NaN or infinite.",
                "Lower learning_rate, alpha or c_dist, and launch the campaign again.",
            )

    def step(self, batch: Decisions, eps: Floats, next_eps: Floats) -> None:
        """Take one gradient step of entropy coefficient, critics and actor, in this order.

        Args:
            batch: batch of transitions, their rewards scaled.
            eps: standard normal draws for the actions in the states, shape (batch, actions).
            next_eps: the same for the next states.
        """
        # Before its own step, as in SB3: critics and actor use the coefficient of the last one.
        coefficient = np.float32(exp(self.entropy[0]))
        choice = self._choose(batch.states, eps)
        self._step_entropy(float(np.mean(choice.log_probability)))
        wanted = self._find_wanted(batch, next_eps, coefficient)
        course = self.critics.forward(np.concatenate([batch.states, batch.actions], axis=1))
        slope = (course[-1] - wanted[:, None]) / np.float32(len(wanted))
        self.critics.descend(course, slope, self._settings.learning_rate)
        self._step_actor(batch.states, choice, coefficient)
        self.targets.follow(self.critics, self._settings.tau)

    def policy(self, version: int) -> Policy:
        """Return the present actor as raw weights."""
        *hidden, (weight, bias) = (
            (weight.copy(), bias.reshape(-1).copy()) for weight, bias in self.actor.layers
        )
        return Policy(
            version=version,
            hidden=tuple(Layer(*layer) for layer in hidden),
            mean=Layer(weight[: self._actions], bias[: self._actions]),
            log_std=Layer(weight[self._actions :], bias[self._actions :]),
            amplitude=self._settings.amplitude,
            hold=self._settings.hold,
        )

    def adopt(self, arrays: Arrays) -> None:
        """Copy the networks and the entropy coefficient from another trainer.

        Raises:
            ValueError: an array is missing or has another shape.
        """
        networks = {"actor": self.actor, "critics": self.critics, "targets": self.targets}
        for name, network in networks.items():
            network.weights[:] = take(arrays, f"{name}.weights", network.weights.shape)
        self.entropy[0] = take(arrays, "entropy", self.entropy.shape)[0]

    def arrays(self) -> Arrays:
        """Return networks, targets, optimizers, entropy coefficient and replay buffer."""
        return {
            **self.actor.arrays("actor"),
            **self.critics.arrays("critics"),
            **self.targets.arrays("targets"),
            **self.memory.arrays("memory"),
            "entropy": self.entropy,
        }

    def load(self, arrays: Arrays) -> None:
        """Restore the state.

        Raises:
            ValueError: an array is missing or has another shape.
        """
        self.actor.load("actor", arrays)
        self.critics.load("critics", arrays)
        self.targets.load("targets", arrays)
        self.memory.load("memory", arrays)
        self.entropy[:] = take(arrays, "entropy", self.entropy.shape)

    def _choose(self, states: Floats, eps: Floats) -> DrawnActions:
        course = self.actor.forward(states)
        mean, log_std = course[-1][:, : self._actions], course[-1][:, self._actions :]
        clamped = np.clip(log_std, LOG_STD_MIN, LOG_STD_MAX)
        std = np.exp(clamped)
        actions = np.tanh(mean + std * eps)
        room: Floats = np.float32(1.0) - actions * actions
        # log N(u) − log(1 − tanh²) (Haarnoja et al. 2018, appendix C), with SB3's 1e-6 in the
        # logarithm.
        density = -0.5 * eps * eps - clamped - LOG_SQRT_TWO_PI - np.log(room + TINY)
        inside = (log_std == clamped).astype(np.float32)
        likelihood: Floats = density.sum(axis=1)
        return DrawnActions(course, eps, inside, std, actions, room, likelihood)

    def _step_entropy(self, log_probability: float) -> None:
        """Adapt the coefficient so that the entropy approaches its target."""
        slope = -(log_probability + self._settings.target_entropy)
        logarithm, mean, square, steps = self.entropy
        steps += 1.0
        mean += (1.0 - BETA1) * (slope - mean)
        square = BETA2 * square + (1.0 - BETA2) * slope * slope
        size = sqrt(square) / sqrt(1.0 - BETA2**steps) + EPSILON
        change = self._settings.learning_rate / (1.0 - BETA1**steps) * mean / size
        self.entropy[:] = logarithm - change, mean, square, steps

    def _find_wanted(self, batch: Decisions, eps: Floats, coefficient: np.float32) -> Floats:
        """Return the target values of the critics for a batch, shape (batch,)."""
        if batch.ends.all():
            # Nothing comes later, as in all episodes of at most `n_step` decisions.
            return batch.rewards
        then = self._choose(batch.next_states, eps)
        seen = np.concatenate([batch.next_states, then.actions], axis=1)
        later = self.targets.forward(seen)[-1][..., 0].min(axis=0)
        later -= coefficient * then.log_probability
        discount = (1.0 - batch.ends) * np.float32(self._gamma)
        wanted: Floats = batch.rewards + discount * later
        return wanted

    def _step_actor(self, states: Floats, choice: DrawnActions, coefficient: np.float32) -> None:
        """Minimise the mean of coefficient · log pi - min Q."""
        count = np.float32(len(states))
        course = self.critics.forward(np.concatenate([states, choice.actions], axis=1))
        values = course[-1]
        # The gradient of a minimum flows through the lesser critic alone.
        lesser = values == values.min(axis=0)
        slope = self.critics.compute_input_gradient(course, -lesser.astype(np.float32) / count)
        sums = slope.sum(axis=0)[:, -self._actions :] * choice.room
        sums += coefficient / count * 2.0 * choice.actions * choice.room / (choice.room + TINY)
        # d log_std: through the action, eps · std, and directly through the density, −1. Clipped
        # values have no slope.
        widths = (sums * choice.std * choice.eps - coefficient / count) * choice.inside
        self.actor.descend(
            choice.course, np.concatenate([sums, widths], axis=1), self._settings.learning_rate
        )
