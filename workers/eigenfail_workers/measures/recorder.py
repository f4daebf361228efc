"""The record of one episode: what was injected, what was seen, what it measures."""

from math import inf, isfinite

import numpy as np

from eigenfail.errors import SimulatorError
from eigenfail.values import Floats, Measures, NoiseTrajectory, Observation, Scene, VehicleState
from eigenfail_workers.measures.conflict import conflict
from eigenfail_workers.measures.geometry import at_least, separation, velocity

Pair = tuple[float, float]


class Recorder:
    """Accumulates an episode; the measures grow with it, the arrays are made at its end."""

    def __init__(self) -> None:
        self._z: list[Pair] = []
        self._sigma: list[Pair] = []
        self._course: list[Observation] = []
        self._robustness_m = inf
        self._min_ttc_s = inf
        self._max_drac_mps2 = 0.0

    @property
    def steps(self) -> int:
        """How many disturbances were injected."""
        return len(self._z)

    @property
    def collided(self) -> bool:
        """Whether the last thing seen was a collision."""
        return bool(self._course) and self._course[-1].collided

    def injects(self, z: Pair, sigma: Pair) -> None:
        """A disturbance is about to be injected; both pairs hold values of float32."""
        self._z.append(z)
        self._sigma.append(sigma)

    def sees(self, observation: Observation) -> None:
        """The start, or the truth after a step.

        Raises:
            SimulatorError: a vehicle is nowhere.
        """
        _check(observation)
        self._course.append(observation)
        for other in observation.others:
            self._compare(observation.ego, other)

    def _compare(self, ego: VehicleState, other: VehicleState) -> None:
        between = separation(ego, other)
        self._robustness_m = min(self._robustness_m, between.distance_m)
        danger = conflict(ego, other, between)
        if danger is not None:
            self._min_ttc_s = min(self._min_ttc_s, danger.ttc_s)
            self._max_drac_mps2 = max(self._max_drac_mps2, danger.drac_mps2)

    def noise(self) -> NoiseTrajectory:
        """The disturbances injected so far."""
        return NoiseTrajectory(z=_pairs(self._z), sigma=_pairs(self._sigma))

    def measures(self) -> Measures:
        """What the episode measured; on a collision, robustness is exactly 0."""
        return Measures(
            robustness_m=0.0 if self.collided else self._robustness_m,
            severity=severity(self._course[-1]) if self.collided else None,
            min_ttc_s=self._min_ttc_s if self._min_ttc_s < inf else None,
            max_drac_mps2=self._max_drac_mps2 if self._max_drac_mps2 > 0.0 else None,
        )

    def scene(self, dt_s: float) -> Scene:
        """The course of the episode."""
        start, *rest = self._course
        vehicles = [[_pose(v) for v in (seen.ego, *seen.others)] for seen in self._course]
        sizes = [(v.length_m, v.width_m) for v in (start.ego, *start.others)]
        controls = [seen.control for seen in rest if seen.control is not None]
        return Scene(
            dt_s=dt_s,
            vehicles=np.array(vehicles, np.float32),
            sizes=np.array(sizes, np.float32),
            perceived=_pairs([seen.perceived for seen in rest if seen.perceived is not None]),
            controls=_pairs([(c.acceleration_mps2, c.steering_rad) for c in controls]),
        )


def _check(observation: Observation) -> None:
    for vehicle in (observation.ego, *observation.others):
        if not isfinite(sum(_pose(vehicle))):
            raise SimulatorError(
                f"After step {observation.step} the simulator shows {vehicle}.",
                "Every position, heading and speed must be a finite number.",
            )


def severity(observation: Observation) -> float:
    """||v_ego - v_actor||² with the vehicle that the ego touches: that of the smallest distance."""
    ego = observation.ego
    touched = min(observation.others, key=lambda other: _closeness(ego, other))
    vx, vy = velocity(ego)
    other_vx, other_vy = velocity(touched)
    return (vx - other_vx) ** 2 + (vy - other_vy) ** 2


def _closeness(ego: VehicleState, other: VehicleState) -> tuple[float, float]:
    """Orders by distance between footprints; of several that overlap, by their circles."""
    return separation(ego, other).distance_m, at_least(ego, other)


def _pose(vehicle: VehicleState) -> tuple[float, float, float, float]:
    return vehicle.x_m, vehicle.y_m, vehicle.heading_rad, vehicle.speed_mps


def _pairs(rows: list[Pair]) -> Floats:
    """An array of shape (rows, 2), also for no rows."""
    return np.array(rows, np.float32).reshape(-1, 2)
