"""A bridge to highway-env's own drivers, which follow IDM and MOBIL. docs/foreign_stacks.md

python idm_vehicle_bridge.py tcp://127.0.0.1:9000
"""

import sys
from typing import Any

import names
from highway_env.vehicle import behavior
from minimal import PROTOCOL, Bridge, serve
from perceived_road import CHANNELS, PerceivedRoad, make

IDLE = 1
FREQUENCY_HZ = 5
# The driver decides in every frame, as the other vehicles of the environment do. It does not use
# the observation of the environment, which therefore is the cheapest one.
CONFIG = {
    "simulation_frequency": FREQUENCY_HZ,
    "policy_frequency": FREQUENCY_HZ,
    "lanes_count": 2,
    "vehicles_count": 8,
    "observation": {"type": "AttributesObservation", "attributes": ["time"]},
}
WELCOME = {
    "type": "welcome",
    "protocol": PROTOCOL,
    "name": "drivers of highway-env",
    "version": "1",
    "slots": 8,
    "scenarios": [
        {
            "name": "highway-fast-v0",
            "dt_s": 1.0 / FREQUENCY_HZ,
            "steps": 80,
            "parameters": {"traffic": 7},
        }
    ],
    "planners": [
        {"name": name, "settings": {}}
        for name in ("IDMVehicle", "LinearVehicle", "AggressiveVehicle", "DefensiveVehicle")
    ],
    "channels": CHANNELS,
}


class StockDriver:
    """A class of vehicles of highway-env that decides for itself, as the ego.

    Args:
        name: name of the class in `highway_env.vehicle.behavior`.
    """

    def __init__(self, name: str) -> None:
        self._kind = getattr(behavior, name)

    def begin(self, environment: Any) -> None:
        """Put a vehicle of this class in the place of the ego."""
        vehicles, before = environment.road.vehicles, environment.vehicle
        ego = self._kind.create_from(before)
        # It is asked once a step, in `decide`: not again when the environment asks everyone.
        ego.act = lambda _action=None: None
        vehicles[vehicles.index(before)] = environment.controlled_vehicles[0] = ego

    def decide(self, environment: Any) -> int:
        """Let the vehicle decide; the action of the environment has no effect on it."""
        self._kind.act(environment.vehicle)
        return IDLE


def drive(asked: dict[str, Any]) -> PerceivedRoad:
    """The environment with the driver of that name in it."""
    given = names.check(WELCOME, asked)
    driver, channels = StockDriver(asked["planner"]), names.check_channels(WELCOME, asked)
    environment = make(asked["scenario"], CONFIG)
    return PerceivedRoad(environment, driver, channels, int(given["traffic"]), asked["steps"])


if __name__ == "__main__":
    serve(sys.argv[1], Bridge(WELCOME, drive))
