"""A truck of SUMO behind a car that brakes, one episode at a time. docs/bridge_examples.md

SUMO's are the car-following model, the motion and the collision test. Ours is which gap the model
is asked about: SUMO by itself would give it the true one.
"""

import sys
from math import radians
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any
from xml.etree.ElementTree import Element, SubElement, tostring

import libsumo
from libsumo import vehicle
from msgspec.json import decode, encode

from eigenfail.values.scene import Control, Observation, VehicleState

DT_S, STEPS = 0.1, 120
MODELS = ("ACC", "IDM", "Krauss")
SETTINGS = {"tau_s": 1.0, "min_gap_m": 2.5}
PARAMETERS = {"gap_m": 25.0, "speed_mps": 22.0, "brakes_at_s": 2.0, "deceleration_mps2": 5.25}
LANE_HALF_WIDTH_M = 1.6
AWAY_M = 1e4

ROAD = """<net version="1.20">
    <edge id="road" from="west" to="east">
        <lane id="road_0" index="0" speed="40" length="5000" shape="0,0 5000,0"/>
    </edge>
    <junction id="west" type="dead_end" x="0" y="0" incLanes="" intLanes="" shape="0,2 0,-2"/>
    <junction id="east" type="dead_end" x="5000" y="0" incLanes="road_0" intLanes=""
              shape="5000,-2 5000,2"/>
</net>"""

WITHIN_ACCELERATION = 2
"""A speed mode: SUMO holds a speed that it is told against the vehicle's acceleration alone."""


def traffic(model: str, given: dict[str, float]) -> str:
    """The truck and the car, as SUMO reads them."""
    routes = Element("routes")
    undrawn = {"sigma": 0, "speedDev": 0, "maxSpeed": given["speed_mps"]}
    driver = {"carFollowModel": model, "tau": given["tau_s"], "minGap": given["min_gap_m"]}
    put(routes, "vType", id="truck", vClass="truck", **driver, **undrawn)
    put(routes, "vType", id="car", vClass="passenger", length=5, **undrawn)
    put(routes, "route", id="along", edges="road")
    at_start = {"route": "along", "depart": 0, "departSpeed": given["speed_mps"]}
    ahead_m = 105.0 + given["gap_m"]
    for name, kind, place_m in (("lead", "car", ahead_m), ("ego", "truck", 100)):
        where = {"departPos": place_m, "insertionChecks": "none"}
        put(routes, "vehicle", id=name, type=kind, **at_start, **where)
    return tostring(routes, "unicode")


def put(parent: Element, tag: str, **attributes: object) -> None:
    """An element; whatever a campaign has set stays an attribute."""
    SubElement(parent, tag, {name: str(value) for name, value in attributes.items()})


class BrakingLead:
    """The scenario, for any number of episodes (contract `Simulation`).

    Args:
        folder: for the files that SUMO reads.
        model: which car-following model of SUMO's drives the truck.
        given: all of PARAMETERS and SETTINGS.
        steps: the horizon.
    """

    dt_s = DT_S

    def __init__(self, folder: Path, model: str, given: dict[str, float], steps: int) -> None:
        self.steps, self._given = steps, given
        road, routes = folder / "road.net.xml", folder / "traffic.rou.xml"
        road.write_text(ROAD)
        routes.write_text(traffic(model, given))
        self._words = [
            *("--net-file", str(road), "--route-files", str(routes), "--step-length", str(DT_S)),
            *("--collision.action", "warn", "--collision.mingap-factor", "0"),
            *("--no-warnings", "--no-step-log"),
        ]

    def reset(self, seed: int) -> Observation:
        """A new world; with these vehicles, SUMO draws nothing from its seed."""
        begin = libsumo.load if libsumo.isLoaded() else start
        begin([*self._words, "--seed", str(seed % 2**31)])
        libsumo.simulationStep()
        vehicle.setSpeedMode("ego", WITHIN_ACCELERATION)
        self._last = Observation(0, state("ego"), (state("lead"),))
        return self._last

    def step(self, disturbance: tuple[float, float]) -> Observation:
        """Ask the model about the disturbed gap, and let SUMO do the rest."""
        ego, lead = self._last.ego, self._last.others[0]
        seen = lead.x_m + disturbance[0], lead.y_m + disturbance[1]
        asked_mps = self._asked_mps(ego, lead, seen)
        vehicle.setSpeed("ego", asked_mps)
        if self._last.step == round(self._given["brakes_at_s"] / DT_S):
            brake(lead.speed_mps / self._given["deceleration_mps2"])
        libsumo.simulationStep()
        self._last = self._now(seen, asked_mps - ego.speed_mps, ego.speed_mps)
        return self._last

    def _asked_mps(self, ego: VehicleState, lead: VehicleState, seen: tuple[float, float]) -> float:
        """The model's next speed behind who is seen, and what the brakes give of it, as in SUMO."""
        gap_m = seen[0] - ego.x_m - (ego.length_m + lead.length_m) / 2.0
        if abs(seen[1] - ego.y_m) > LANE_HALF_WIDTH_M:
            gap_m = AWAY_M
        follow_mps = vehicle.getFollowSpeed(
            "ego",
            ego.speed_mps,
            gap_m - self._given["min_gap_m"],
            lead.speed_mps,
            vehicle.getDecel("lead"),
            "lead",
        )
        hardest_mps = ego.speed_mps - vehicle.getEmergencyDecel("ego") * DT_S
        return float(max(min(follow_mps, self._given["speed_mps"]), hardest_mps, 0.0))

    def _now(self, seen: tuple[float, float], asked_mps: float, before_mps: float) -> Observation:
        ego, step = state("ego"), self._last.step + 1
        collided = libsumo.simulation.getCollidingVehiclesNumber() > 0
        return Observation(
            step,
            ego,
            (state("lead"),),
            collided,
            collided or step == self.steps,
            seen,
            Control(asked_mps / DT_S, 0.0),
            Control((ego.speed_mps - before_mps) / DT_S, 0.0),
        )


def start(words: list[str]) -> None:
    """The first world of this process."""
    libsumo.start(["sumo", *words])


def brake(duration_s: float) -> None:
    """The car comes to a stop, and stays."""
    vehicle.setSpeedMode("lead", 0)
    vehicle.slowDown("lead", 0.0, duration_s)
    vehicle.setMaxSpeed("lead", 0.01)


def state(name: str) -> VehicleState:
    """Where a vehicle of SUMO is; SUMO tells the middle of its front, and the angle from north."""
    length_m, (front_m, y_m) = vehicle.getLength(name), vehicle.getPosition(name)
    heading_rad = radians(90.0 - vehicle.getAngle(name))
    speed_mps, width_m = vehicle.getSpeed(name), vehicle.getWidth(name)
    return VehicleState(front_m - length_m / 2.0, y_m, heading_rad, speed_mps, length_m, width_m)


def live() -> None:
    """Read lines of JSON: what to open is answered by nothing, seeds and disturbances are."""
    with TemporaryDirectory() as folder:
        for line in sys.stdin:
            told: Any = decode(line)
            if isinstance(told, dict):
                world = BrakingLead(Path(folder), **told)
                continue
            seen = world.reset(told) if isinstance(told, int) else world.step(tuple(told))
            print(encode(seen).decode(), flush=True)


if __name__ == "__main__":
    live()
