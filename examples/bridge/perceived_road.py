"""An environment of highway-env whose driver perceives it with errors. docs/foreign_stacks.md

The driver is asked while the road is as it perceives it; then the road is put back, and moves on
from what is true.
"""

from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from math import hypot
from typing import Any, Protocol

import gymnasium
import highway_env
import numpy as np

from eigenfail.errors import SimulatorError
from eigenfail.values.scene import Observation, VehicleState

CHANNELS = ["longitudinal", "lateral", "speed", "missed"]
BORDER_POINTS = 50


class Driver(Protocol):
    """A driver of another package."""

    def begin(self, environment: Any) -> None:
        """Take the wheel of an environment that was reset."""

    def decide(self, environment: Any) -> int:
        """Return the action of the next step, from the environment as it is perceived."""


class PerceivedRoad:
    """Episodes in a stock environment (contract `Simulation`).

    Args:
        environment: the environment, as `make` returns it.
        driver: drives the ego.
        channels: names of the disturbances of a step, in their order.
        traffic: number from which the environment draws all that is random in it.
        steps: the horizon.
    """

    def __init__(
        self,
        environment: Any,
        driver: Driver,
        channels: Sequence[str],
        traffic: int,
        steps: int,
    ) -> None:
        self._environment = environment
        self.dt_s = 1.0 / self._environment.config["policy_frequency"]
        self.steps = steps
        self._driver, self._channels, self._traffic = driver, channels, traffic

    def reset(self, seed: int) -> Observation:  # noqa: ARG002 - the contract's; see `traffic`
        """Begin an episode in the traffic that the environment draws from `traffic`."""
        self._environment.reset(seed=self._traffic)
        self._driver.begin(self._environment)
        self._last = Observation(0, *self._truth())
        return self._last

    def step(self, disturbance: Sequence[float]) -> Observation:
        """Let the driver decide on the disturbed road, and move the true one by one action."""
        if self._last.ended:
            raise SimulatorError("There is no episode to go on with.", "Reset it first.")
        errors = dict(zip(self._channels, disturbance, strict=True))
        with perceive(self._environment, errors) as seen:
            action = self._driver.decide(self._environment)
        self._environment.step(action)
        step, collided = self._last.step + 1, bool(self._environment.vehicle.crashed)
        ended = collided or step == self.steps
        self._last = Observation(step, *self._truth(), collided, ended, seen)
        return self._last

    def road(self) -> list[list[list[float]]]:
        """Borders of all lanes [m]."""
        lanes = self._environment.road.network.lanes_list()
        return [border(lane, side) for lane in lanes for side in (-0.5, 0.5)]

    def _truth(self) -> tuple[VehicleState, tuple[VehicleState, ...]]:
        ego = self._environment.vehicle
        return state(ego), tuple(state(each) for each in others(self._environment))


def make(name: str, config: Mapping[str, Any]) -> Any:
    """Return the environment of a name that gymnasium knows.

    Without the wrappers of gymnasium, one of which ends episodes by itself.
    """
    gymnasium.register_envs(highway_env)
    return gymnasium.make(name, config=dict(config)).unwrapped


@contextmanager
def perceive(environment: Any, errors: Mapping[str, float]) -> Iterator[tuple[float, float]]:
    """Show the road with errors of the nearest vehicle; yields where that is perceived [m].

    NaN where it is missed. The road is as before when the block ends.
    """
    road, ego = environment.road, environment.vehicle
    nearest = min(others(environment), key=lambda each: hypot(*(each.position - ego.position)))
    position, speed_mps, vehicles = nearest.position, nearest.speed, road.vehicles
    away_m = np.array([errors.get("longitudinal", 0.0), errors.get("lateral", 0.0)])
    nearest.position = position + away_m
    nearest.speed = speed_mps + errors.get("speed", 0.0)
    seen = float(nearest.position[0]), float(nearest.position[1])
    if errors.get("missed", 0.0) > 0.0:
        road.vehicles = [each for each in vehicles if each is not nearest]
        seen = float("nan"), float("nan")
    try:
        yield seen
    finally:
        nearest.position, nearest.speed, road.vehicles = position, speed_mps, vehicles


def others(environment: Any) -> list[Any]:
    """All vehicles but the ego, in the order of the environment."""
    return [each for each in environment.road.vehicles if each is not environment.vehicle]


def state(vehicle: Any) -> VehicleState:
    """State of a vehicle of highway-env."""
    x_m, y_m = map(float, vehicle.position)
    heading_rad, speed_mps = float(vehicle.heading), float(vehicle.speed)
    return VehicleState(x_m, y_m, heading_rad, speed_mps, vehicle.LENGTH, vehicle.WIDTH)


def border(lane: Any, side: float) -> list[list[float]]:
    """Points of one border of a lane [m], at half its width on the side given by the sign."""
    places = [lane.length * each / BORDER_POINTS for each in range(BORDER_POINTS + 1)]
    points = [lane.position(s, side * lane.width_at(s)) for s in places]
    return [[float(x), float(y)] for x, y in points]
