"""A bridge to a DQN agent of stable-baselines3, in highway-env. docs/foreign_stacks.md

python dqn_bridge.py tcp://127.0.0.1:9000
"""

import sys
from hashlib import sha256
from io import BytesIO
from pathlib import Path
from typing import Any

import names
import numpy as np
from dqn_settings import CONFIG, ENVIRONMENT, HORIZON
from highway_env.envs.common.observation import observation_factory
from minimal import PROTOCOL, Bridge, serve
from numpy.typing import NDArray
from perceived_road import CHANNELS, PerceivedRoad, make

from eigenfail.errors import SimulatorError

POLICY = Path(__file__).with_name("dqn_policy.npz")
DIGEST = "6922d4f8a132fbe8aa4fa4366b74b0b4d2e5ef8b55875bcc313e8cf59cbbc20f"
"""SHA-256 of the file of the policy."""

TESTED = CONFIG | {"observation": {"type": "AttributesObservation", "attributes": ["time"]}}
"""The environment's own observation, of the true road, is not used, and is the cheapest one."""

WELCOME = {
    "type": "welcome",
    "protocol": PROTOCOL,
    "name": "DQN of stable-baselines3",
    "version": "1",
    "slots": 8,
    "scenarios": [
        {"name": ENVIRONMENT, "dt_s": 1.0, "steps": HORIZON, "parameters": {"traffic": 1}}
    ],
    "planners": [{"name": "DQN", "settings": {}}],
    "channels": CHANNELS,
}


class Agent:
    """The action with the highest value in the observation that the environment makes.

    Args:
        arrays: weights (n_out, n_in) and biases (n_out,) of the layers, as `dqn_training.py` names
            them.
    """

    def __init__(self, arrays: dict[str, NDArray[np.float32]]) -> None:
        layers = range(len(arrays) // 2)
        self._layers = [(arrays[f"weight_{i}"], arrays[f"bias_{i}"]) for i in layers]

    def begin(self, environment: Any) -> None:
        """Observe the road from the ego of an environment that was reset."""
        self._observation = observation_factory(environment, CONFIG["observation"])

    def decide(self, _environment: Any) -> int:
        """Return the number of the action, from the observation of the perceived road."""
        return int(np.argmax(self.value_actions(self._observation.observe())))

    def value_actions(self, observation: NDArray[np.float32]) -> NDArray[np.float32]:
        """Return the expected return of every action (n_actions,), for rows of vehicles."""
        signal = observation.reshape(-1)
        for weight, bias in self._layers[:-1]:
            signal = np.maximum(weight @ signal + bias, 0.0)
        weight, bias = self._layers[-1]
        return np.asarray(weight @ signal + bias, np.float32)


def read_policy() -> dict[str, NDArray[np.float32]]:
    """Return the arrays of the file; raises SimulatorError if it is another file."""
    content = POLICY.read_bytes()
    if sha256(content).hexdigest() != DIGEST:
        raise SimulatorError(f"{POLICY.name} is not the file of this bridge.", "Fetch it anew.")
    with np.load(BytesIO(content), allow_pickle=False) as arrays:
        return {name: arrays[name] for name in arrays.files}


def drive(asked: dict[str, Any]) -> PerceivedRoad:
    """The environment with the agent in it."""
    given = names.check(WELCOME, asked)
    agent, channels = Agent(read_policy()), names.check_channels(WELCOME, asked)
    environment = make(asked["scenario"], TESTED)
    return PerceivedRoad(environment, agent, channels, int(given["traffic"]), asked["steps"])


if __name__ == "__main__":
    serve(sys.argv[1], Bridge(WELCOME, drive))
