"""Files of stable-baselines3 drive as stable-baselines3 does, and run no code of their own."""

import base64
import json
import pickle
import zipfile
from contextlib import closing
from pathlib import Path

import numpy as np
import pytest
from approach_environment import ID, Approach

from eigenfail.values.channels import Channel
from eigenfail_gymnasium.environments import GymnasiumParameters
from eigenfail_gymnasium.policies import PolicyPlanner, PolicySettings, read_model
from eigenfail_gymnasium.scenario import GymnasiumScenario
from eigenfail_gymnasium.simulator import GymnasiumSimulator
from eigenfail_gymnasium.stages import PolicyTask

TASK = PolicyTask(Approach.observation_space, Approach.action_space, 1.0, {}, (), {})


def save(algorithm, **arguments):
    """Save an agent that has learnt nothing, and return it."""
    import stable_baselines3

    kind = getattr(stable_baselines3, algorithm)
    agent = kind("MlpPolicy", Approach(), seed=5, device="cpu", **arguments)
    agent.save("agent.zip")
    return agent


@pytest.mark.parametrize(
    ("algorithm", "arguments"),
    [
        ("DQN", {"buffer_size": 10, "policy_kwargs": {"net_arch": [8, 8]}}),
        ("PPO", {}),
    ],
)
def test_a_model_answers_as_its_agent(algorithm, arguments):
    agent = save(algorithm, **arguments)
    policy = read_model(PolicySettings(model="agent.zip", algorithm=algorithm), TASK)
    for observation in np.random.default_rng(0).normal(0.0, 5.0, (50, 2)).astype(np.float32):
        assert policy(observation) == agent.predict(observation, deterministic=True)[0]


class Bomb:
    """Leaves a file behind where it is unpickled."""

    def __reduce__(self):
        return Path.touch, (Path("exploded"),)


def test_pickled_parts_of_a_file_are_not_opened():
    save("PPO")
    hidden = base64.b64encode(pickle.dumps(Bomb())).decode()
    with zipfile.ZipFile("agent.zip") as old, zipfile.ZipFile("bomb.zip", "w") as new:
        for name in old.namelist():
            if name != "data":
                new.writestr(name, old.read(name))
        data = {"policy_kwargs": {":type:": "x", ":serialized:": hidden}}
        new.writestr("data", json.dumps(data))
    planner = PolicyPlanner(PolicySettings(model="bomb.zip", algorithm="PPO"))
    channels = (Channel("observation.0").filled(),)
    parameters = GymnasiumParameters(env=ID)
    with closing(
        GymnasiumSimulator().open(GymnasiumScenario(), parameters, planner, channels)
    ) as simulation:
        simulation.reset(0)
        simulation.step((0.0,))
    assert not Path("exploded").exists()
    pickle.loads(base64.b64decode(hidden))
    assert Path("exploded").exists()
