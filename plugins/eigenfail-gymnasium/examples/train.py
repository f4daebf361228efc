"""Train a DQN agent of stable-baselines3 in the environment of a campaign, without noise.

    python train.py merge.toml merge_dqn.zip --steps 3000

A fixed seed; other versions of torch, and other processors, may round differently.
"""

import argparse
import warnings
from pathlib import Path

import torch
from gymnasium.wrappers import TimeLimit
from stable_baselines3 import DQN
from stable_baselines3.common.monitor import Monitor

from eigenfail.cli.specs import read_spec
from eigenfail.settings import read_settings
from eigenfail_gymnasium.environments import GymnasiumParameters, find_horizon, make_environment

SEED = 2026


def train(file: Path, steps: int) -> DQN:
    """Return the agent after some steps in the environment of a campaign."""
    given = read_spec(file).scenario_parameters
    parameters = read_settings(GymnasiumParameters, given, "scenario_parameters")
    env = make_environment(parameters)
    limited = TimeLimit(env, find_horizon(env, parameters))
    # The settings of highway-env's documentation, and a larger share of exploration.
    return DQN(
        "MlpPolicy",
        Monitor(limited),
        policy_kwargs={"net_arch": [64, 64]},
        learning_rate=5e-4,
        buffer_size=15_000,
        learning_starts=200,
        batch_size=32,
        gamma=0.8,
        target_update_interval=50,
        exploration_fraction=0.5,
        seed=SEED,
        device="cpu",
    ).learn(steps)


if __name__ == "__main__":
    warnings.simplefilter("ignore")
    torch.set_num_threads(1)
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("campaign", type=Path)
    parser.add_argument("model")
    parser.add_argument("--steps", type=int, default=3000)
    given = parser.parse_args()
    train(given.campaign, given.steps).save(given.model)
