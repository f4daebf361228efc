"""Simulator on highway-env's road, vehicles and collision test, without its gym environments."""

import sys
from collections.abc import Iterator
from importlib import import_module
from importlib.util import find_spec, module_from_spec
from typing import Any

import numpy as np
from numpy.typing import NDArray

from eigenfail.contracts import Planner, Scenario, Simulation, Situation
from eigenfail.values import Control, Mission, VehicleState
from eigenfail_workers.closed_loop import DrivenSimulation, GroundTruth

PACKAGE = "highway_env"


def _import_parts(*names: str) -> list[Any]:
    """Modules of highway-env, imported without the package's own `__init__`.

    That registers environments, and loads pandas and matplotlib for them: it would take longer than
    all the rest of a worker's start. A later import of highway-env gets the whole of it.
    """
    spec = find_spec(PACKAGE)
    if PACKAGE in sys.modules or spec is None:
        return [import_module(name) for name in names]
    sys.modules[PACKAGE] = module_from_spec(spec)
    try:
        return [import_module(name) for name in names]
    finally:
        for name in [name for name in sys.modules if name.partition(".")[0] == PACKAGE]:
            del sys.modules[name]


_lane, _road, _kinematics = _import_parts(
    "highway_env.road.lane", "highway_env.road.road", "highway_env.vehicle.kinematics"
)
StraightLane: Any = _lane.StraightLane
Road: Any = _road.Road
RoadNetwork: Any = _road.RoadNetwork
Vehicle: Any = _kinematics.Vehicle

ROAD_BEHIND_M = 1_000.0
ROAD_AHEAD_M = 10_000.0


class Mover(Vehicle):  # type: ignore[misc]  # highway-env has no types
    """A vehicle of highway-env with the footprint of a `VehicleState`."""

    position: NDArray[np.float64]
    heading: float
    speed: float

    def __init__(self, road: Road, state: VehicleState) -> None:
        self.LENGTH, self.WIDTH = state.length_m, state.width_m
        super().__init__(road, (state.x_m, state.y_m), state.heading_rad, state.speed_mps)

    def on_state_update(self) -> None:
        """Skip the search for the lane, which takes most time and is not used here."""

    def state(self) -> VehicleState:
        """Return the present state."""
        x, y = self.position.tolist()
        return VehicleState(x, y, float(self.heading), float(self.speed), self.LENGTH, self.WIDTH)


class Truck(Mover):
    """The ego: highway-env's kinematic bicycle, driven by the planner's controls."""

    def drive(self, control: Control, dt_s: float) -> None:
        """Move by one step; braking ends at rest."""
        self.act({"acceleration": control.acceleration_mps2, "steering": control.steering_rad})
        self.step(dt_s)
        self.speed = max(self.speed, 0.0)


class Puppet(Mover):
    """An actor, placed by its script."""

    def place(self, state: VehicleState) -> None:
        """Set position, heading and speed."""
        self.position = np.array((state.x_m, state.y_m))
        self.heading, self.speed = state.heading_rad, state.speed_mps


class HighwayWorld:
    """A straight road of highway-env with the ego and the actors on it. Implements `TrafficWorld`.

    A collision is highway-env's: two rectangles that overlap at the end of a step. Its look ahead
    (dt > 0) is not used: it moves vehicles that are about to touch by an impact, and calls them
    crashed only a step later, so that the collision would not be where the physics put it.
    """

    _situation: Situation
    _ego: Truck
    _actors: tuple[Puppet, ...]
    _step: int

    def reset(self, situation: Situation) -> GroundTruth:
        """Place the vehicles of the situation on a new road."""
        road = Road(straight_lanes(situation.mission))
        self._situation = situation
        self._step = 0
        self._ego = Truck(road, situation.ego)
        self._actors = tuple(Puppet(road, state) for state in situation.actors)
        road.vehicles.extend((self._ego, *self._actors))
        return self._truth(self._ego.state(), situation.actors)

    def advance(self, control: Control) -> GroundTruth:
        """Drive the ego, then place the actors, then test for collisions."""
        self._step += 1
        self._ego.drive(control, self._situation.mission.dt_s)
        ego = self._ego.state()
        move = self._situation.move_actor
        states = tuple(move(i, self._step, ego) for i in range(len(self._actors)))
        for actor, state in zip(self._actors, states, strict=True):
            actor.place(state)
        return self._truth(ego, states)

    def _truth(self, ego: VehicleState, others: tuple[VehicleState, ...]) -> GroundTruth:
        for actor in self._actors:
            self._ego.handle_collisions(actor, dt=0)
        return GroundTruth(ego, others, self._ego.crashed)


def straight_lanes(mission: Mission) -> RoadNetwork:
    """Return the mission's lanes; lane 0 has its centre at y = 0, and may end."""
    network = RoadNetwork()
    for begin, end, lanes in _sections(mission):
        for number in lanes:
            y = number * mission.lane_width_m
            network.add_lane(
                str(begin),
                str(end),
                StraightLane(
                    [begin, y],
                    [end, y],
                    width=mission.lane_width_m,
                    speed_limit=mission.speed_limit_mps,
                ),
            )
    return network


def _sections(mission: Mission) -> Iterator[tuple[float, float, range]]:
    """Yield begin [m], end [m] and lanes of each section of the road."""
    ends_x_m = mission.lane_0_ends_x_m
    if ends_x_m is None:
        yield -ROAD_BEHIND_M, ROAD_AHEAD_M, range(mission.lanes)
        return
    yield -ROAD_BEHIND_M, ends_x_m, range(mission.lanes)
    yield ends_x_m, ROAD_AHEAD_M, range(1, mission.lanes)


class HighwaySimulator:
    """Opens simulations on highway-env."""

    def open(self, scenario: Scenario, parameters: Any, planner: Planner) -> Simulation:
        """Return a simulation of the planner in the scenario."""
        return DrivenSimulation(HighwayWorld(), scenario, parameters, planner)
