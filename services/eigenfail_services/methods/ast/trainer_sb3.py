"""Trainer on stable-baselines3's SAC, with rollouts of workers."""

from itertools import chain
from typing import cast

import gymnasium
import numpy as np
import torch
from stable_baselines3 import SAC
from stable_baselines3.common.buffers import ReplayBuffer
from stable_baselines3.common.logger import Logger
from stable_baselines3.common.type_aliases import ReplayBufferSamples

from eigenfail.errors import LearnerDiverged
from eigenfail.values.learning import Layer, Policy, count_state
from eigenfail_services.methods import tensors
from eigenfail_services.methods.archive import Array, Arrays, take
from eigenfail_services.methods.ast.decisions import Decisions
from eigenfail_services.methods.ast.settings import REWARD_SCALE, AstSettings

KEPT = ("observations", "next_observations", "actions", "rewards", "dones")


class SpaceHolder(gymnasium.Env[Array, Array]):
    """Environment that gives SAC its shapes and is never stepped."""

    def __init__(self, states: int, actions: int) -> None:
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (states,), np.float32)
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (actions,), np.float32)


class SeededBuffer(ReplayBuffer):
    """SB3's replay buffer with its own generator instead of numpy's global one."""

    generator: np.random.Generator

    def sample(self, batch_size: int, env: object = None) -> ReplayBufferSamples:  # noqa: ARG002 - SB3's signature
        """Return a batch, drawn with replacement."""
        # SB3 draws from numpy's global generator, which any plug-in may move.
        rows = self.generator.integers(self.size(), size=batch_size)
        columns = {name: self.to_torch(getattr(self, name)[rows, 0]) for name in KEPT}
        return ReplayBufferSamples(
            observations=columns["observations"],
            actions=columns["actions"],
            next_observations=columns["next_observations"],
            dones=columns["dones"].reshape(-1, 1),
            rewards=columns["rewards"].reshape(-1, 1),
        )


class SacTrainer:
    """Soft actor-critic on one core, as small networks gain nothing from more threads.

    Args:
        settings: settings of the method.
        channels: number of channels of the noise, each a component of an action.
        seed: seed of the first weights and of all batches.
    """

    def __init__(self, settings: AstSettings, channels: int, seed: int) -> None:
        torch.set_num_threads(1)
        self._settings, self._seed = settings, seed
        with tensors.isolate_randomness(seed, 0):
            self._model = _make_model(settings, channels)
        # SB3 makes a logger in `learn`, which is never called here, and `train` logs to it.
        self._model.set_logger(Logger(None, []))
        self._buffer = cast("SeededBuffer", self._model.replay_buffer)

    def add(self, decisions: Decisions) -> None:
        """Add transitions to the replay buffer, which drops the oldest ones."""
        for i in range(len(decisions.rewards)):
            self._buffer.add(
                decisions.states[i],
                decisions.next_states[i],
                decisions.actions[i],
                decisions.rewards[i] * REWARD_SCALE,
                decisions.ends[i],
                # An info without "TimeLimit.truncated": an end is an end.
                [{}],
            )

    def train(self, steps: int, draw: int) -> None:
        """Take gradient steps.

        Raises:
            LearnerDiverged: a weight became NaN or infinite.
        """
        with tensors.isolate_randomness(self._seed, draw) as generator:
            self._buffer.generator = generator
            try:
                self._model.train(gradient_steps=steps, batch_size=self._settings.batch_size)
            except ValueError as error:  # torch's distributions refuse a mean of NaN
                raise _make_divergence() from error
        if not tensors.all_finite(chain(self._model.policy.parameters(), [self._entropy()])):
            raise _make_divergence()

    def policy(self, version: int) -> Policy:
        """Return the present actor as a policy with raw weights."""
        actor = self._model.actor
        layers = [layer for layer in actor.latent_pi if isinstance(layer, torch.nn.Linear)]
        return Policy(
            version=version,
            hidden=tuple(_layer(layer) for layer in layers),
            mean=_layer(cast("torch.nn.Linear", actor.mu)),
            log_std=_layer(cast("torch.nn.Linear", actor.log_std)),
            amplitude=self._settings.amplitude,
            hold=self._settings.hold,
        )

    def adopt(self, arrays: Arrays) -> None:
        """Copy the networks and the entropy coefficient from another trainer.

        Raises:
            ValueError: an array is missing or has another shape.
        """
        tensors.load_module("policy", self._model.policy, arrays)
        tensors.copy_into(self._entropy(), arrays, "entropy")

    def arrays(self) -> Arrays:
        """Return networks, targets, optimizers, entropy coefficient and replay buffer."""
        model, buffer, size = self._model, self._buffer, self._buffer.size()
        return {
            **tensors.module_arrays("policy", model.policy),
            "entropy": self._entropy().detach().numpy(),
            **{
                name: array
                for prefix, optimizer in self._optimizers().items()
                for name, array in tensors.adam_arrays(prefix, optimizer).items()
            },
            **{f"buffer.{name}": getattr(buffer, name)[:size] for name in KEPT},
            "buffer.position": np.array([size, buffer.pos], np.int64),
        }

    def load(self, arrays: Arrays) -> None:
        """Restore the state.

        Raises:
            ValueError: an array is missing or has another shape.
        """
        tensors.load_module("policy", self._model.policy, arrays)
        tensors.copy_into(self._entropy(), arrays, "entropy")
        for prefix, optimizer in self._optimizers().items():
            tensors.load_adam(prefix, optimizer, arrays)
        self._load_buffer(arrays)

    def _load_buffer(self, arrays: Arrays) -> None:
        size, position = (int(n) for n in take(arrays, "buffer.position", (2,)))
        buffer = self._buffer
        if not (0 <= size <= buffer.buffer_size and 0 <= position < buffer.buffer_size):
            raise ValueError(f"a buffer of {size} does not fit one of {buffer.buffer_size}")
        for name in KEPT:
            own = getattr(buffer, name)
            own[:size] = take(arrays, f"buffer.{name}", (size, *own.shape[1:]))
        buffer.pos, buffer.full = position, size == buffer.buffer_size

    def _entropy(self) -> torch.Tensor:
        return cast("torch.Tensor", self._model.log_ent_coef)

    def _optimizers(self) -> dict[str, torch.optim.Adam]:
        model = self._model
        found = {
            "actor": model.actor.optimizer,
            "critic": model.critic.optimizer,
            "coefficient": model.ent_coef_optimizer,
        }
        return {name: item for name, item in found.items() if isinstance(item, torch.optim.Adam)}


def _make_model(settings: AstSettings, channels: int) -> SAC:
    return SAC(
        "MlpPolicy",
        SpaceHolder(count_state(channels), channels),
        learning_rate=settings.learning_rate,
        buffer_size=settings.buffer_size,
        batch_size=settings.batch_size,
        tau=settings.tau,
        # Of decisions that are summed over `n_step`, each is one transition.
        gamma=settings.gamma**settings.n_step,
        ent_coef=f"auto_{settings.entropy * REWARD_SCALE}",
        target_entropy=settings.target_entropy,
        replay_buffer_class=SeededBuffer,
        policy_kwargs={"net_arch": list(settings.hidden), "optimizer_kwargs": {"fused": True}},
        device="cpu",
    )


def _layer(linear: torch.nn.Linear) -> Layer:
    return Layer(
        linear.weight.detach().numpy().astype(np.float32, copy=True),
        linear.bias.detach().numpy().astype(np.float32, copy=True),
    )


def _make_divergence() -> LearnerDiverged:
    return LearnerDiverged(
        "Soft actor-critic diverged: a weight became NaN or infinite.",
        "Lower learning_rate, alpha or c_dist, and launch the campaign again.",
    )
