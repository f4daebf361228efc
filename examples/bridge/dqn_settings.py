"""The environment of highway-env in which the DQN agent is trained, and tested."""

from typing import Any

ENVIRONMENT = "highway-fast-v0"
CONFIG: dict[str, Any] = {
    "lanes_count": 2,
    "vehicles_count": 8,
    "vehicles_density": 1,
    "duration": 30,
    "observation": {
        "type": "Kinematics",
        "absolute": False,
        "see_behind": True,
        "vehicles_count": 5,
        "features_range": {"x": [-60, 60], "y": [-12, 12], "vx": [-30, 30], "vy": [-15, 15]},
    },
    "action": {
        "type": "DiscreteMetaAction",
        "lateral": False,
        "target_speeds": [10, 15, 20, 25, 30],
    },
}
HORIZON = 20
"""Steps of an episode, one in each second."""
