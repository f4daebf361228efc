"""A bridge to the planners of fiss-planner, with its controller. docs/foreign_stacks.md

    python fiss_bridge.py tcp://127.0.0.1:9000

The planner, the controller that follows the plan and the motion of the ego are the package's. Ours
are the straight road and the cars on it, one of which changes into the ego's lane and brakes.
"""

import sys
from collections.abc import Sequence
from math import atan2, cos, nan, pi, sin
from typing import Any, NamedTuple

import fiss_planner as fiss
import names
from minimal import PROTOCOL, Bridge, serve

from eigenfail.errors import SimulatorError
from eigenfail.values.scene import Control, Observation, VehicleState

DT_S, CONTROLS_PER_STEP, STEPS = 0.1, 2, 100
LANE_WIDTH_M, ROAD_M = 3.5, (-100.0, 1000.0)
CAR_M = 4.5, 1.8
HORIZON_S = 6.0
PARAMETERS = {
    "speed_mps": 22.0,
    "gap_m": 38.0,
    "cutter_speed_mps": 18.0,
    "lane_change_s": 3.0,
    "brakes_at_s": 2.5,
    "deceleration_mps2": 5.0,
    "neighbour_gap_m": -2.0,
}
WELCOME = {
    "type": "welcome",
    "protocol": PROTOCOL,
    "name": "fiss-planner",
    "version": "1",
    "slots": 16,
    "scenarios": [
        {"name": "cut_in_and_brake", "dt_s": DT_S, "steps": STEPS, "parameters": PARAMETERS}
    ],
    "planners": [{"name": name, "settings": {}} for name in ("fiss_plus", "fiss", "fop")],
    "channels": ["longitudinal", "lateral", "speed", "missed"],
}


class Car(NamedTuple):
    """A car on the road: position of its centre, heading, speed."""

    x_m: float
    y_m: float
    heading_rad: float
    speed_mps: float

    def state(self) -> VehicleState:
        """The car with its footprint."""
        return VehicleState(*self, *CAR_M)

    def box(self) -> fiss.Box2d:
        """Its footprint, as the package's test of overlaps takes it."""
        return fiss.Box2d(self.x_m, self.y_m, self.heading_rad, *CAR_M)


class CutInAndBrake:
    """Episodes on a road of three lanes (contract `Simulation`).

    Args:
        planner: name of one of the package's planners.
        channels: names of the disturbances of a step, in their order.
        given: all of PARAMETERS.
        steps: the horizon.
    """

    dt_s = DT_S

    def __init__(
        self, planner: str, channels: Sequence[str], given: dict[str, float], steps: int
    ) -> None:
        self.steps, self._given, self._channels = steps, given, channels
        self._config = fiss.LocalPlannerConfig()
        self._config.planner.type = fiss.planner_type_from_string(planner)
        self._config.path.lane_width = LANE_WIDTH_M
        self._config.desired_speed = given["speed_mps"]
        self._vehicle = fiss.VehicleParams()
        self._vehicle.length, self._vehicle.width = CAR_M

    def reset(self, seed: int) -> Observation:  # noqa: ARG002 - nothing is random but the noise
        """Begin an episode with a planner and a controller that remember nothing."""
        start = fiss.EgoState(0.0, 0.0, 0.0, self._given["speed_mps"])
        self._planner = fiss.LocalPlanner(self._config, self._vehicle)
        self._planner.set_reference_path(list(ROAD_M), [0.0, 0.0])
        self._controller = fiss.make_controller("mpc", self._vehicle)
        self._ego = fiss.KinematicBicycle(self._vehicle, start)
        self._cutter = Car(self._given["gap_m"], LANE_WIDTH_M, 0.0, self._given["cutter_speed_mps"])
        behind_m = self._given["neighbour_gap_m"]
        self._neighbour = Car(behind_m, -LANE_WIDTH_M, 0.0, self._given["speed_mps"])
        self._last = Observation(0, self._truth().state(), self._others())
        return self._last

    def step(self, disturbance: Sequence[float]) -> Observation:
        """Plan on the perceived cars, follow the plan for a step, and move the true cars."""
        if self._last.ended:
            raise SimulatorError("There is no episode to go on with.", "Reset it first.")
        errors = dict(zip(self._channels, disturbance, strict=True))
        time_s = self._last.step * DT_S
        obstacles, seen = self._perceive(errors)
        plan = self._planner.step(time_s, self._ego.state, obstacles)
        for control in range(CONTROLS_PER_STEP):
            ahead_s = control * DT_S / CONTROLS_PER_STEP
            asked = self._controller.compute(self._ego.state, plan.trajectory, ahead_s)
            self._ego.step(asked, DT_S / CONTROLS_PER_STEP)
        step = self._last.step + 1
        self._move(step * DT_S)
        ego = self._truth()
        collided = any(
            fiss.overlaps(ego.box(), car.box()) for car in (self._cutter, self._neighbour)
        )
        ended = collided or step == self.steps
        asked_for = Control(float(asked.accel), float(asked.steer))
        others = self._others()
        self._last = Observation(step, ego.state(), others, collided, ended, seen, asked_for)
        return self._last

    def road(self) -> list[list[list[float]]]:
        """Borders of the three lanes [m]."""
        sides = [(lane - 0.5) * LANE_WIDTH_M for lane in range(-1, 3)]
        return [[[x, y] for x in ROAD_M] for y in sides]

    def _perceive(
        self, errors: dict[str, float]
    ) -> tuple[list[fiss.Obstacle], tuple[float, float]]:
        """Both cars with the package's own prediction, the nearer one with its errors."""
        ego = self._ego.state
        cars = [self._cutter, self._neighbour]
        nearest = min(cars, key=lambda car: (car.x_m - ego.x) ** 2 + (car.y_m - ego.y) ** 2)
        number = cars.index(nearest)
        seen = (
            nearest.x_m + errors.get("longitudinal", 0.0),
            nearest.y_m + errors.get("lateral", 0.0),
        )
        speed_mps = max(nearest.speed_mps + errors.get("speed", 0.0), 0.0)
        cars[number] = Car(*seen, nearest.heading_rad, speed_mps)
        shown = list(enumerate(cars, 1))
        if errors.get("missed", 0.0) > 0.0:
            del shown[number]
            seen = nan, nan
        predict = fiss.predict_constant_velocity
        return [predict(one, *car, *CAR_M, HORIZON_S, DT_S) for one, car in shown], seen

    def _move(self, time_s: float) -> None:
        """Move both cars to a time: the neighbour keeps its speed."""
        given, cutter = self._given, self._cutter
        brakes = time_s > given["brakes_at_s"]
        less_mps = given["deceleration_mps2"] * DT_S if brakes else 0.0
        speed_mps = max(cutter.speed_mps - less_mps, 0.0)
        part = min(time_s / given["lane_change_s"], 1.0)
        y_m = LANE_WIDTH_M * (0.5 + 0.5 * cos(pi * part))
        across_mps = -LANE_WIDTH_M * 0.5 * pi / given["lane_change_s"] * sin(pi * part)
        heading_rad = atan2(across_mps, speed_mps) if part < 1.0 and speed_mps > 1.0 else 0.0
        self._cutter = Car(cutter.x_m + speed_mps * DT_S, y_m, heading_rad, speed_mps)
        self._neighbour = self._neighbour._replace(
            x_m=self._neighbour.x_m + self._neighbour.speed_mps * DT_S
        )

    def _truth(self) -> Car:
        ego = self._ego.state
        return Car(ego.x, ego.y, ego.yaw, ego.v)

    def _others(self) -> tuple[VehicleState, ...]:
        return self._cutter.state(), self._neighbour.state()


def cut_in_and_brake(asked: dict[str, Any]) -> CutInAndBrake:
    """The scenario with the planner of that name."""
    given = names.check(WELCOME, asked)
    channels = names.check_channels(WELCOME, asked)
    return CutInAndBrake(asked["planner"], channels, given, asked["steps"])


if __name__ == "__main__":
    serve(sys.argv[1], Bridge(WELCOME, cut_in_and_brake))
