"""A bridge to a stock environment of highway-env. docs/bridge_examples.md

    python highway_env_bridge.py tcp://127.0.0.1:9000

Environment and driver know nothing of eigenfail: the environment is `merge-v1` of gymnasium, as it
comes; the driver reads the observation, and answers with one of the environment's actions.
"""

import sys
from math import hypot
from typing import Any

import gymnasium
import highway_env
import names
import numpy as np
from minimal import PROTOCOL, Bridge, serve
from numpy.typing import NDArray

from eigenfail.values.scene import Observation, VehicleState

IDLE, FASTER, SLOWER = 1, 3, 4
PRESENCE, X, Y, VX = range(4)
CAR_LENGTH_M, HALF_LANE_M = 5.0, 2.2
SOON_S = 3.0

CONFIG = {
    "observation": {
        "type": "Kinematics",
        "normalize": False,
        "see_behind": True,
        "vehicles_count": 5,
        "include_obstacles": False,
    },
    "action": {"type": "DiscreteMetaAction", "target_speeds": [0, 5, 10, 15, 20, 25, 30]},
    "simulation_frequency": 5,
}
SCENARIO = {"name": "merge-v1", "dt_s": 1.0, "steps": 11, "parameters": {"traffic": 4}}
WELCOME = {
    "type": "welcome",
    "protocol": PROTOCOL,
    "name": "highway-env",
    "version": "1",
    "slots": 8,
    "scenarios": [SCENARIO],
    "planners": [{"name": "headway", "settings": {"headway_s": 0.4}}],
    "channels": ["longitudinal", "lateral"],
}


def drive(seen: NDArray[np.float32], headway_s: float) -> int:
    """The driver: an action for an observation. Rows of others hold what is relative to its own."""
    speed_mps = seen[0, VX]
    ahead = [row for row in seen[1:] if row[PRESENCE] and abs(row[Y]) < HALF_LANE_M and row[X] > 0]
    gaps_m = [max(row[X] - CAR_LENGTH_M, 0.0) for row in ahead]
    times_s = [gap / -row[VX] for gap, row in zip(gaps_m, ahead, strict=True) if row[VX] < 0]
    gap_m = min(gaps_m, default=np.inf)
    if gap_m < headway_s * speed_mps or min(times_s, default=np.inf) < SOON_S:
        return SLOWER
    return FASTER if gap_m > 1.5 * headway_s * speed_mps else IDLE


class Merge:
    """The environment with the driver in it (contract `Simulation`).

    Args:
        asked: of a reset, what is to begin.
    """

    dt_s = SCENARIO["dt_s"]

    def __init__(self, asked: dict[str, Any]) -> None:
        given, self._channels = names.check(WELCOME, asked), names.check_channels(WELCOME, asked)
        gymnasium.register_envs(highway_env)
        self.steps = asked["steps"]
        self._traffic, self._headway_s = given["traffic"], given["headway_s"]
        self._environment = gymnasium.make(asked["scenario"], config=CONFIG)

    def reset(self, seed: int) -> Observation:  # noqa: ARG002 - the contract's; see `traffic`
        """Begin an episode in the traffic that the environment makes of that number."""
        self._seen, _ = self._environment.reset(seed=self._traffic)
        self._last = Observation(0, *self._truth())
        return self._last

    def step(self, disturbance: tuple[float, ...]) -> Observation:
        """Disturb the row of the nearest vehicle, and go on by one action."""
        if self._last.ended:
            raise RuntimeError("There is no episode to go on with.")
        errors = dict(zip(self._channels, disturbance, strict=True))
        disturbed = self._seen.copy()
        away_m = [hypot(row[X], row[Y]) if row[PRESENCE] else np.inf for row in disturbed[1:]]
        nearest = disturbed[1 + int(np.argmin(away_m))]
        nearest[X : Y + 1] += [errors.get("longitudinal", 0.0), errors.get("lateral", 0.0)]
        action = drive(disturbed, self._headway_s)
        self._seen, _, _, _, told = self._environment.step(action)
        step, collided = self._last.step + 1, bool(told["crashed"])
        ended = collided or step == self.steps
        self._last = Observation(step, *self._truth(), collided, ended)
        return self._last

    def _truth(self) -> tuple[VehicleState, tuple[VehicleState, ...]]:
        world = self._environment.unwrapped
        others = (each for each in world.road.vehicles if each is not world.vehicle)
        return state(world.vehicle), tuple(state(each) for each in others)

    def close(self) -> None:
        """Let go of the environment."""
        self._environment.close()


def state(vehicle: Any) -> VehicleState:
    """Where a vehicle of highway-env is."""
    x_m, y_m = map(float, vehicle.position)
    heading_rad, speed_mps = float(vehicle.heading), float(vehicle.speed)
    return VehicleState(x_m, y_m, heading_rad, speed_mps, vehicle.LENGTH, vehicle.WIDTH)


if __name__ == "__main__":
    serve(sys.argv[1], Bridge(WELCOME, Merge))
