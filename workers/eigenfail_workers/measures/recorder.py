"""The record of one episode: what was injected, what was seen, what it measures."""

from math import inf, isfinite

import numpy as np

from eigenfail.errors import SimulatorError
from eigenfail.values import (
    Floats,
    Measures,
    NoiseTrajectory,
    Observation,
    Scene,
    Shape,
    VehicleState,
    White,
)
from eigenfail_workers.measures.conflict import conflict
from eigenfail_workers.measures.geometry import at_least, separation, velocity
from eigenfail_workers.measures.ride import Ride
from eigenfail_workers.measures.violations import Violations

Pair = tuple[float, float]

AS_IN_THE_PAPER = White()


class Recorder:
    """Accumulates an episode; the measures grow with it, the arrays are made at its end.

    Args:
        shape: of the noise whose z it is told.
    """

    def __init__(self, shape: Shape = AS_IN_THE_PAPER) -> None:
        self._shape = shape
        self._z: list[Pair] = []
        self._sigma: list[Pair] = []
        self._course: list[Observation] = []
        self._robustness_m = inf
        self._violations = Violations()
        self._ride = Ride()
        self._left_road_step: int | None = None
        self._last_drac_mps2 = 0.0

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
        self._ride.sees(observation)
        if observation.off_road and self._left_road_step is None:
            self._left_road_step = observation.step
        self._last_drac_mps2 = 0.0
        for vehicle in range(len(observation.others)):
            self._compare(observation, vehicle)

    def _compare(self, observation: Observation, vehicle: int) -> None:
        ego, other = observation.ego, observation.others[vehicle]
        between = separation(ego, other)
        self._robustness_m = min(self._robustness_m, between.distance_m)
        danger = conflict(ego, other, between)
        if danger is not None:
            self._violations.heed(observation.step, vehicle, danger)
            self._last_drac_mps2 = max(self._last_drac_mps2, danger.drac_mps2)

    def noise(self) -> NoiseTrajectory:
        """The disturbances injected so far."""
        return NoiseTrajectory(_pairs(self._z), _pairs(self._sigma), self._shape)

    def measures(self, dt_s: float) -> Measures:
        """What the episode measured; on a collision, robustness is exactly 0."""
        last, found, ride = self._course[-1], self._violations, self._ride
        collided = self.collided
        first = found.by(struck(last)) if collided else found.by_anybody()
        return Measures(
            robustness_m=0.0 if collided else self._robustness_m,
            severity=severity(last) if collided else None,
            min_ttc_s=found.min_ttc_s,
            max_drac_mps2=found.max_drac_mps2,
            ttc_violated_s=_time_s(first.ttc_step, dt_s),
            drac_violated_s=_time_s(first.drac_step, dt_s),
            drac_at_warning_mps2=first.drac_at_warning_mps2,
            collided_s=_time_s(last.step if collided else None, dt_s),
            left_road_s=_time_s(self._left_road_step, dt_s),
            max_jerk_mps3=ride.max_jerk_mps3(dt_s),
            hard_brakings=ride.hard_brakings,
            clipped_steps=ride.clipped_steps,
            final_drac_mps2=None if collided else self._last_drac_mps2,
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


def struck(observation: Observation) -> int:
    """Which of the others the ego touches: the one at the smallest distance."""
    ego, others = observation.ego, observation.others
    return min(range(len(others)), key=lambda vehicle: _closeness(ego, others[vehicle]))


def severity(observation: Observation) -> float:
    """||v_ego - v_actor||² with the vehicle that was struck. [m²/s²]"""
    vx, vy = velocity(observation.ego)
    other_vx, other_vy = velocity(observation.others[struck(observation)])
    return (vx - other_vx) ** 2 + (vy - other_vy) ** 2


def _closeness(ego: VehicleState, other: VehicleState) -> tuple[float, float]:
    """Orders by distance between footprints; of several that overlap, by their circles."""
    return separation(ego, other).distance_m, at_least(ego, other)


def _time_s(step: int | None, dt_s: float) -> float | None:
    return None if step is None else step * dt_s


def _pose(vehicle: VehicleState) -> tuple[float, float, float, float]:
    return vehicle.x_m, vehicle.y_m, vehicle.heading_rad, vehicle.speed_mps


def _pairs(rows: list[Pair]) -> Floats:
    """An array of shape (rows, 2), also for no rows."""
    return np.array(rows, np.float32).reshape(-1, 2)
