"""Soft actor-critic of stable-baselines3, with which the trainer of `ast` is compared."""

import gymnasium
import numpy as np
import torch
from stable_baselines3 import SAC
from stable_baselines3.common.buffers import ReplayBuffer
from stable_baselines3.common.logger import Logger
from stable_baselines3.common.type_aliases import ReplayBufferSamples

from eigenfail.values.learning import Layer, Policy, count_state
from eigenfail_services.methods.ast.settings import REWARD_SCALE

KEPT = ("observations", "next_observations", "actions", "rewards", "dones")


class SpaceHolder(gymnasium.Env):
    """An environment that gives SAC its shapes, and is never stepped."""

    def __init__(self, states, actions):
        self.observation_space = gymnasium.spaces.Box(-np.inf, np.inf, (states,), np.float32)
        self.action_space = gymnasium.spaces.Box(-1.0, 1.0, (actions,), np.float32)


class SeededBuffer(ReplayBuffer):
    """SB3's replay buffer with its own generator instead of numpy's global one."""

    def sample(self, batch_size, env=None):
        """Return a batch, drawn with replacement."""
        rows = self.generator.integers(self.size(), size=batch_size)
        columns = {name: self.to_torch(getattr(self, name)[rows, 0]) for name in KEPT}
        return ReplayBufferSamples(
            observations=columns["observations"],
            actions=columns["actions"],
            next_observations=columns["next_observations"],
            dones=columns["dones"].reshape(-1, 1),
            rewards=columns["rewards"].reshape(-1, 1),
        )


class ReferenceTrainer:
    """Trains as `ast` does, by SB3's SAC on one core.

    Attributes:
        model: SB3's model, with networks and optimizers.
        buffer: its replay buffer.
    """

    def __init__(self, settings, channels, seed):
        torch.set_num_threads(1)
        self._settings, self._seed = settings, seed
        # Networks draw their first weights from torch's global generator, which is put back.
        with torch.random.fork_rng(devices=[]):
            torch.manual_seed(int(np.random.default_rng([seed, 0]).integers(2**63)))
            self.model = SAC(
                "MlpPolicy",
                SpaceHolder(count_state(channels), channels),
                learning_rate=settings.learning_rate,
                buffer_size=settings.buffer_size,
                batch_size=settings.batch_size,
                tau=settings.tau,
                gamma=settings.gamma**settings.n_step,
                ent_coef=f"auto_{settings.entropy * REWARD_SCALE}",
                target_entropy=settings.target_entropy,
                replay_buffer_class=SeededBuffer,
                policy_kwargs={
                    "net_arch": list(settings.hidden),
                    "optimizer_kwargs": {"fused": True},
                },
                device="cpu",
            )
        # SB3 makes a logger in `learn`, which is never called here, and `train` logs to it.
        self.model.set_logger(Logger(None, []))
        self.buffer = self.model.replay_buffer

    def add(self, decisions):
        """Add transitions to the replay buffer."""
        for i in range(len(decisions.rewards)):
            self.buffer.add(
                decisions.states[i],
                decisions.next_states[i],
                decisions.actions[i],
                decisions.rewards[i] * REWARD_SCALE,
                decisions.ends[i],
                # An info without "TimeLimit.truncated": an end is an end.
                [{}],
            )

    def train(self, steps, draw):
        """Take gradient steps, with the batches of draw number `draw`."""
        self.buffer.generator = np.random.default_rng([self._seed, draw])
        self.model.train(gradient_steps=steps, batch_size=self._settings.batch_size)

    def policy(self, version):
        """Return the present actor as a policy with raw weights."""
        actor = self.model.actor
        layers = [layer for layer in actor.latent_pi if isinstance(layer, torch.nn.Linear)]
        return Policy(
            version=version,
            hidden=tuple(map(copy_layer, layers)),
            mean=copy_layer(actor.mu),
            log_std=copy_layer(actor.log_std),
            amplitude=self._settings.amplitude,
            hold=self._settings.hold,
        )


def copy_layer(linear):
    """Return the weights of a layer as arrays."""
    return Layer(*(array.detach().numpy().copy() for array in (linear.weight, linear.bias)))
