"""The DQN agent of dqn_bridge.py: trained with stable-baselines3, written as plain arrays.

    pip install '.[worker,server]'
    python dqn_training.py dqn_policy.npz

About two minutes on one core. The seed is fixed; other versions of torch, and other processors, may
round differently and so train another agent.
"""

import sys
from typing import Any

import gymnasium
import highway_env
import numpy as np
import torch
from dqn_settings import CONFIG, ENVIRONMENT
from stable_baselines3 import DQN
from stable_baselines3.common.monitor import Monitor

SEED = 2026
STEPS = 4_000
"""After 6,000 steps the agent drove faster, and collided in more traffics without noise."""


def train() -> DQN:
    """Return the agent after all steps."""
    return build(make(SEED)).learn(STEPS)


def build(environment: Any) -> DQN:
    """Return an agent that has learnt nothing.

    The settings are those of highway-env's documentation, but for the share of the steps with
    exploration, since it trains for longer.
    """
    return DQN(
        "MlpPolicy",
        environment,
        policy_kwargs={"net_arch": [256, 256]},
        learning_rate=5e-4,
        buffer_size=15_000,
        learning_starts=200,
        batch_size=32,
        gamma=0.8,
        train_freq=1,
        gradient_steps=1,
        target_update_interval=50,
        exploration_fraction=0.25,
        seed=SEED,
        device="cpu",
    )


def make(seed: int) -> Any:
    """Return an environment whose episodes are drawn from the seed."""
    gymnasium.register_envs(highway_env)
    environment = Monitor(gymnasium.make(ENVIRONMENT, config=CONFIG))
    environment.reset(seed=seed)
    return environment


def read_arrays(model: DQN) -> dict[str, np.ndarray[Any, Any]]:
    """Return weights (n_out, n_in) and biases (n_out,) of the network's layers, by name."""
    layers = [each for each in model.q_net.q_net if isinstance(each, torch.nn.Linear)]
    arrays = {}
    for number, layer in enumerate(layers):
        arrays[f"weight_{number}"] = layer.weight.detach().numpy().astype(np.float32)
        arrays[f"bias_{number}"] = layer.bias.detach().numpy().astype(np.float32)
    return arrays


if __name__ == "__main__":
    torch.set_num_threads(1)
    np.savez(sys.argv[1], **read_arrays(train()))
