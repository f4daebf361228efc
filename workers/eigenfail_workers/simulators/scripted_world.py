"""A world of footprints: the ego is driven by its controls, the others by the scenario."""

from collections.abc import Callable
from typing import Any

from eigenfail.contracts import ReactiveSituation, Situation, TrafficModel
from eigenfail.values.scene import Control, VehicleState
from eigenfail_workers.measures.encounters import TrafficSample, find_contact, may_touch, touch
from eigenfail_workers.values import GroundTruth

Physics = Callable[[VehicleState, Control, float], VehicleState]
"""Moves the ego: its state after a step, of its state, the acting control, and the step [s]."""


class ScriptedWorld:
    """Vehicles as moving footprints; an overlap is a collision, within a step and at its end.

    Implements `TrafficWorld`.

    Args:
        drive: physics of the ego.
    """

    _situation: Any
    _traffic: TrafficModel | None
    _now: GroundTruth
    _step: int

    def __init__(self, drive: Physics) -> None:
        self._drive = drive

    def reset(self, situation: Situation | ReactiveSituation) -> GroundTruth:
        """Place the vehicles of the situation."""
        self._situation = situation
        self._step = 0
        self._traffic = None
        ids: tuple[int, ...] | None = None
        if isinstance(situation, ReactiveSituation):
            self._traffic = situation.start_traffic()
            ids = tuple(range(1, len(situation.actors) + 1))
        self._now = _find_truth(situation.ego, situation.actors, ids)
        return self._now

    def advance(self, control: Control) -> GroundTruth:
        """Drive the ego, then move the others, then test for collisions.

        If the ego touches a vehicle within the step, the vehicles are shown at the first contact.
        """
        before, dt_s = self._now, self._situation.mission.dt_s
        self._step += 1
        self._now = self._move(self._drive(before.ego, control, dt_s))
        earlier, later = _make_sample(before), _make_sample(self._now)
        # In nearly all steps nothing can touch: the search of the step is spared.
        if may_touch(earlier, later):
            contact = find_contact(earlier, later, dt_s)
            if contact is not None:
                self._now = GroundTruth(contact.ego, contact.others, True, self._now.ids)
        return self._now

    def _move(self, ego: VehicleState) -> GroundTruth:
        """Return the truth at the end of a step, once the ego has moved."""
        situation = self._situation
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
    return GroundTruth(ego, others, any(touch(ego, other) for other in others), ids)


def _make_sample(truth: GroundTruth) -> TrafficSample:
    numbers = range(1, len(truth.others) + 1) if truth.ids is None else truth.ids
    return TrafficSample(truth.ego, truth.others, numbers)
