"""What a planner perceives: the truth, disturbed by the channels of a campaign."""

from math import nan

from eigenfail.values import Observation, Perception, VehicleState
from eigenfail.values.channels import DELAY, GHOST, MISSED, Channel, split_name
from eigenfail.values.channels import EGO as EGO_NAME
from eigenfail.values.shapes import Row
from eigenfail_workers.measures.geometry import find_hidden, find_nearest
from eigenfail_workers.values import Point

NEAREST = -1
EGO = -2
"""Targets of channels besides the vehicles, which are numbered from 0."""

_MISSED, _GHOST, _DELAY = 6, 7, 8
_FIELDS = {
    "longitudinal": 0,
    "lateral": 1,
    "heading": 2,
    "speed": 3,
    "length": 4,
    "width": 5,
    MISSED: _MISSED,
    GHOST: _GHOST,
    DELAY: _DELAY,
}
"""Places of the quantities: those of a vehicle's state, then the others."""

LEAST_SIZE_M = 0.1
"""Length and width that a vehicle is perceived with, however large the error is."""

NOWHERE: Point = (nan, nan)

GHOST_LENGTH_M, GHOST_WIDTH_M = 5.0, 2.0
"""Those of a car."""


def find_target(name: str) -> int:
    """Return the target of a channel: the index of a vehicle, NEAREST or EGO."""
    channel = split_name(name)
    if channel.target == EGO_NAME:
        return EGO
    return NEAREST if channel.vehicle is None else channel.vehicle - 1


class SensorErrors:
    """Disturbs the perception of a planner, with an error of each channel at each step.

    Args:
        channels: the channels, in the order of the errors.
        occlusion: whether vehicles that others hide are not detected.
    """

    def __init__(self, channels: tuple[Channel, ...], occlusion: bool = False) -> None:
        self._occlusion = occlusion
        self._channels = [
            (find_target(channel.name), _FIELDS[split_name(channel.name).quantity])
            for channel in channels
        ]
        self._ahead_m = max([0.0, *[channel.ahead_m or 0.0 for channel in channels]])
        self._is_delayed = any(field == _DELAY for _, field in self._channels)
        self._ghost: VehicleState | None = None
        self._seen: list[tuple[VehicleState, ...]] = []

    def reset(self) -> None:
        """Begin an episode."""
        self._ghost = None
        self._seen = []

    def perceive(self, now: Observation, dt_s: float, errors: Row) -> tuple[Perception, Point]:
        """Return what the planner perceives, and where it sees the nearest vehicle.

        Args:
            now: the truth.
            dt_s: duration of a step.
            errors: a_t of each channel, in its unit.
        """
        actor = find_nearest(now.ego, now.others)
        others = self._find_delayed(now, dt_s, errors) if self._is_delayed else now.others
        changed: dict[int, list[float]] = {}
        missed = find_hidden(now.ego, now.others) if self._occlusion else set()
        for (target, field), error in zip(self._channels, errors, strict=True):
            vehicle = actor if target == NEAREST else target
            if field == _GHOST:
                self._ghost = self._follow_ghost(now.ego) if error > 0.5 else None
                continue
            if field == _DELAY:
                continue
            if field == _MISSED:
                if error > 0.5:
                    missed.add(vehicle)
                continue
            if vehicle not in changed:
                true = now.ego if vehicle == EGO else others[vehicle]
                changed[vehicle] = list_fields(true)
            changed[vehicle][field] += error
        ego = make_state(changed[EGO]) if EGO in changed else now.ego
        numbers = [number for number in range(len(now.others)) if number not in missed]
        seen = {
            number: make_state(changed[number]) if number in changed else others[number]
            for number in numbers
        }
        if self._ghost is not None:
            seen[len(now.others)] = self._ghost
        ids = tuple([number + 1 for number in seen])
        position = (seen[actor].x_m, seen[actor].y_m) if actor in seen else NOWHERE
        return Perception(now.step * dt_s, ego, tuple(seen.values()), ids), position

    def _find_delayed(self, now: Observation, dt_s: float, errors: Row) -> tuple[VehicleState, ...]:
        """Return the other vehicles as they were before the delay, or at the start."""
        self._seen.append(now.others)
        delay_s = sum(
            abs(error)
            for (_, field), error in zip(self._channels, errors, strict=True)
            if field == _DELAY
        )
        return self._seen[max(len(self._seen) - 1 - round(delay_s / dt_s), 0)]

    def _follow_ghost(self, ego: VehicleState) -> VehicleState:
        """Return the ghost, which stands where it was when its event began."""
        if self._ghost is not None:
            return self._ghost
        x_m = ego.x_m + self._ahead_m
        return VehicleState(x_m, ego.y_m, 0.0, 0.0, GHOST_LENGTH_M, GHOST_WIDTH_M)


def list_fields(vehicle: VehicleState) -> list[float]:
    """Return the numbers of a vehicle, in the order of its fields."""
    return [
        vehicle.x_m,
        vehicle.y_m,
        vehicle.heading_rad,
        vehicle.speed_mps,
        vehicle.length_m,
        vehicle.width_m,
    ]


def make_state(fields: list[float]) -> VehicleState:
    """Return a vehicle with these numbers, of some size at least."""
    x_m, y_m, heading_rad, speed_mps, length_m, width_m = fields
    return VehicleState(
        x_m,
        y_m,
        heading_rad,
        speed_mps,
        max(length_m, LEAST_SIZE_M),
        max(width_m, LEAST_SIZE_M),
    )
