"""A world of footprints: the ego is driven by its controls, the others by the scenario."""

from collections.abc import Callable
from typing import Any

from eigenfail.contracts import ReactiveSituation, Situation, TrafficModel
from eigenfail.values import Control, VehicleState
from eigenfail_workers.measures.geometry import distance_lower_bound, separation
from eigenfail_workers.values import GroundTruth

Physics = Callable[[VehicleState, Control, float], VehicleState]
"""Moves the ego: its state after a step, of its state, the acting control, and the step [s]."""


class ScriptedWorld:
    """Vehicles as moving footprints; an overlap at the end of a step is a collision.

    Implements `TrafficWorld`.

    Args:
        drive: physics of the ego.
    """

    _situation: Any
    _traffic: TrafficModel | None
    _ego: VehicleState
    _step: int

    def __init__(self, drive: Physics) -> None:
        self._drive = drive

    def reset(self, situation: Situation | ReactiveSituation) -> GroundTruth:
        """Place the vehicles of the situation."""
        self._situation = situation
        self._ego = situation.ego
        self._step = 0
        self._traffic = None
        ids: tuple[int, ...] | None = None
        if isinstance(situation, ReactiveSituation):
            self._traffic = situation.start_traffic()
            ids = tuple(range(1, len(situation.actors) + 1))
        return _find_truth(situation.ego, situation.actors, ids)

    def advance(self, control: Control) -> GroundTruth:
        """Drive the ego, then move the others, then test for collisions."""
        situation = self._situation
        self._step += 1
        ego = self._ego = self._drive(self._ego, control, situation.mission.dt_s)
        if self._traffic is not None:
            there = self._traffic.advance(self._step, ego)
            return _find_truth(ego, tuple(there.values()), tuple(there))
        states = [
            situation.move_actor(actor, self._step, ego) for actor in range(len(situation.actors))
        ]
        return _find_truth(ego, tuple(states))


def _find_truth(
    ego: VehicleState, others: tuple[VehicleState, ...], ids: tuple[int, ...] | None = None
) -> GroundTruth:
    return GroundTruth(ego, others, any(_touches(ego, other) for other in others), ids)


def _touches(ego: VehicleState, other: VehicleState) -> bool:
    return distance_lower_bound(ego, other) <= 0.0 and separation(ego, other).distance_m == 0.0
