"""Signals of an episode, step by step, for the requirements of its campaign."""

from collections.abc import Mapping, Sequence
from math import cos, nan, sin
from typing import Final

import numpy as np

from eigenfail.errors import SimulatorError
from eigenfail.values.disturbance import NoiseTrajectory
from eigenfail.values.scene import LanePosition, Observation, VehicleState
from eigenfail.values.signals import BRIDGE, ERROR, NEVER_S, NOBODY_M, PLANNER, SIGNALS, Samples
from eigenfail_workers.measures.geometry import half_width_across_road, velocity
from eigenfail_workers.values import Encounter

R157_INSIDE_M: Final = 0.3
"""A vehicle has cut in once it is so far inside the lane (UN R157, 5.2.5.2)."""

R157_BRAKING_MPS2: Final = 6.0
R157_REACTION_S: Final = 0.35
"""A cut-in is preventable above a time to collision of v_rel / (2 · 6 m/s²) + 0.35 s (ibid.)."""


REPORTED: Final = (f"{BRIDGE}.", f"{PLANNER}.")
"""Beginnings of the names of the signals that a bridge or a planner reports."""


class CutIns:
    """Finds vehicles that cut in so late that UN R157 considers a collision unpreventable."""

    def __init__(self) -> None:
        self._inside: set[int] = set()
        self._excused: set[int] = set()
        self._centre_m = nan

    def find_excused(
        self,
        ego: VehicleState,
        others: Sequence[VehicleState],
        lane: LanePosition,
        numbers: Sequence[int] | None = None,
    ) -> set[int]:
        """Return the vehicles that do not count after a step; call it in the order of the steps.

        Vehicles that are in the lane at the start, or that the ego changes lanes to, have not cut
        in.

        Args:
            ego: the ego.
            others: every other vehicle that is there.
            lane: lane of the ego.
            numbers: number of each vehicle, which identifies it in later steps; default: its place.
        """
        centre_m = ego.y_m - lane.offset_m
        same_lane = abs(centre_m - self._centre_m) < 0.5 * lane.width_m
        self._centre_m = centre_m
        for number, other in zip(numbers or range(len(others)), others, strict=True):
            reach_m = half_width_across_road(other) - abs(other.y_m - centre_m)
            inside_m = 0.5 * lane.width_m + reach_m
            # It has left the lane: when it comes back, that is another cut-in.
            if inside_m <= 0.0:
                self._inside.discard(number)
                self._excused.discard(number)
            elif inside_m >= R157_INSIDE_M and number not in self._inside:
                self._inside.add(number)
                if same_lane and not is_preventable(ego, other):
                    self._excused.add(number)
        return self._excused


def is_preventable(ego: VehicleState, other: VehicleState) -> bool:
    """Return whether UN R157 requires avoiding a collision with a vehicle that cuts in now.

    A vehicle alongside the ego leaves no time. A vehicle that is not slower leaves unlimited time.
    """
    gap_m = find_gap(ego, other)
    closing_mps = velocity(ego)[0] - velocity(other)[0]
    if gap_m <= 0.0 or closing_mps <= 0.0:
        return gap_m > 0.0
    least_s = closing_mps / (2.0 * R157_BRAKING_MPS2) + R157_REACTION_S
    return gap_m / closing_mps > least_s


def find_gap(ego: VehicleState, other: VehicleState) -> float:
    """Return the distance along the road from the ego's front to the rear of a vehicle. [m]"""
    return other.x_m - ego.x_m - _half_length_along_road(ego) - _half_length_along_road(other)


def _half_length_along_road(vehicle: VehicleState) -> float:
    along = vehicle.length_m * abs(cos(vehicle.heading_rad))
    return 0.5 * (along + vehicle.width_m * abs(sin(vehicle.heading_rad)))


def find_leader(ego: VehicleState, others: Sequence[VehicleState]) -> tuple[float, float]:
    """Return the gap to the next vehicle ahead in the path of the ego, and its speed. [m, m/s]

    A vehicle is in the path if the footprints overlap across the road. Without a vehicle ahead, the
    values are NOBODY_M and the speed of the ego.
    """
    gap_m, speed_mps = NOBODY_M, velocity(ego)[0]
    for other in others:
        beside_m = abs(other.y_m - ego.y_m)
        overlaps = beside_m < half_width_across_road(ego) + half_width_across_road(other)
        if overlaps and other.x_m > ego.x_m:
            found_m = max(find_gap(ego, other), 0.0)
            if found_m < gap_m:
                gap_m, speed_mps = found_m, velocity(other)[0]
    return gap_m, speed_mps


class SignalRecorder:
    """Records the signals of one episode.

    Args:
        wanted: names of the signals that are needed.
    """

    def __init__(self, wanted: frozenset[str]) -> None:
        self._wanted = wanted
        self._needs_lane = any(SIGNALS[name].needs_lane for name in wanted if name in SIGNALS)
        self._reported = sorted([name for name in wanted if name.startswith(REPORTED)])
        self._values: dict[str, list[float]] = {name: [] for name in (*SIGNALS, *self._reported)}
        self._cut_ins = CutIns()
        self._was_moving = True

    def observe(self, now: Observation, encounters: Sequence[Encounter]) -> None:
        """Take in the start, or the state after a step.

        Args:
            now: the state.
            encounters: the ego with each other vehicle, in their order.

        Raises:
            SimulatorError: the lane of the ego, or a signal of a bridge or planner, is needed but
                missing.
        """
        values, ego = self._values, now.ego
        distances = [each.distance_m for each in encounters]
        conflicts = [conflict for each in encounters for conflict in each.conflicts]
        gap_m, leader_mps = find_leader(ego, now.others)
        values["distance_m"].append(0.0 if now.collided else min(distances))
        values["ttc_s"].append(min([NEVER_S, *[each.ttc_s for each in conflicts]]))
        ahead = [
            conflict.ttc_s
            for each, other in zip(encounters, now.others, strict=True)
            for conflict in each.conflicts
            if other.x_m > ego.x_m
        ]
        values["ttc_ahead_s"].append(min([NEVER_S, *ahead]))
        values["drac_mps2"].append(max([0.0, *[each.drac_mps2 for each in conflicts]]))
        values["gap_m"].append(gap_m)
        values["leader_speed_mps"].append(leader_mps)
        values["headway_s"].append(
            min(gap_m / ego.speed_mps, NEVER_S)
            if ego.speed_mps > 0.0 and gap_m < NOBODY_M
            else NEVER_S
        )
        values["speed_mps"].append(ego.speed_mps)
        values["acceleration_mps2"].append(self._find_acceleration(now))
        if self._needs_lane:
            self._observe_lane(now, distances)
        for name in self._reported:
            self._observe_reported(name, now)

    def _observe_reported(self, name: str, now: Observation) -> None:
        # A bridge reports its signals by their own names. Those of a planner have their prefix
        # already (`SignallingSimulation`).
        value = (now.signals or {}).get(name.removeprefix(f"{BRIDGE}."))
        if value is None:
            raise SimulatorError(
                f"After step {now.step} the simulator does not tell the signal '{name}'.",
                "Report it at the start and after every step.",
            )
        self._values[name].append(value)

    def _find_acceleration(self, now: Observation) -> float:
        """Return the acceleration that was applied; NaN if it is not reported. [m/s²]

        A truck at rest does not brake, whatever its control is.
        """
        was_moving, self._was_moving = self._was_moving, now.ego.speed_mps > 0.0
        if now.step == 0:
            return 0.0
        if now.applied is None:
            return nan
        applied_mps2 = now.applied.acceleration_mps2
        return applied_mps2 if was_moving else max(applied_mps2, 0.0)

    def _observe_lane(self, now: Observation, distances: Sequence[float]) -> None:
        lane = now.lane
        if lane is None:
            raise SimulatorError(
                f"After step {now.step} the simulator does not tell the lane of the ego.",
                "Set `lane` of the observation, or take a requirement that needs none.",
            )
        values, ego = self._values, now.ego
        excused = self._cut_ins.find_excused(ego, now.others, lane, now.numbers)
        counted = [
            each
            for number, each in zip(now.numbers, distances, strict=True)
            if number not in excused
        ]
        nearest_m = min([NOBODY_M, *counted])
        # The distance is 0 only if the vehicle that was struck is one that counts.
        struck = now.collided and nearest_m == min(distances)
        values["preventable_distance_m"].append(0.0 if struck else nearest_m)
        values["lane_offset_m"].append(lane.offset_m)
        margin_m = 0.5 * lane.width_m - abs(lane.offset_m) - half_width_across_road(ego)
        values["lane_margin_m"].append(margin_m)

    def collect(
        self, noise: NoiseTrajectory, channels: Sequence[str], dt_s: float
    ) -> Mapping[str, Samples]:
        """Return the signals that are wanted, each of shape (steps + 1,).

        Args:
            noise: of the whole episode.
            channels: names of its channels.
            dt_s: duration of a step.
        """
        found = {name: np.array(each, np.float64) for name, each in self._values.items() if each}
        speeds, accelerations = found["speed_mps"], found["acceleration_mps2"]
        changes = np.diff(speeds, prepend=speeds[:1]) / dt_s
        # Bridges need not report the applied control: the change of speed stands in for it.
        accelerations = np.where(np.isnan(accelerations), changes, accelerations)
        found["acceleration_mps2"] = accelerations
        found["jerk_mps3"] = np.diff(accelerations, prepend=0.0) / dt_s
        # Nothing is disturbed yet at the start, which has a sample, too.
        errors = np.vstack([np.zeros(len(channels)), noise.injected])
        found |= {f"{ERROR}.{name}": errors[:, k] for k, name in enumerate(channels)}
        return {name: found[name] for name in self._wanted}
