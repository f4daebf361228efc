"""The perception of a planner: the truth, disturbed by the channels of a campaign."""

from math import hypot, nan

from eigenfail.values.channels import DELAY, GHOST, MISSED, SWAPPED, Channel, split_name
from eigenfail.values.channels import EGO as EGO_NAME
from eigenfail.values.scene import Observation, Perception, VehicleState
from eigenfail.values.shapes import Row
from eigenfail_workers.measures.geometry import find_hidden, find_nearest
from eigenfail_workers.values import Point

NEAREST = -1
EGO = -2
"""Targets of channels besides the vehicles, which are numbered from 0."""

_FIELDS = {"longitudinal": 0, "lateral": 1, "heading": 2, "speed": 3, "length": 4, "width": 5}
"""Places of the quantities in a vehicle's state; events and a delay have none."""

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
        named = [(place, split_name(one.name).quantity) for place, one in enumerate(channels)]
        targets = [find_target(channel.name) for channel in channels]
        self._errors = [
            (place, targets[place], _FIELDS[name]) for place, name in named if name in _FIELDS
        ]
        self._misses = [(place, targets[place]) for place, name in named if name == MISSED]
        self._ghosts = [place for place, name in named if name == GHOST]
        self._swaps = [place for place, name in named if name == SWAPPED]
        self._delays = [place for place, name in named if name == DELAY]
        self._ahead_m = max([0.0, *[channel.ahead_m or 0.0 for channel in channels]])
        self._ghost: VehicleState | None = None
        self._seen: list[dict[int, VehicleState]] = []
        self._vehicles = 0

    def reset(self, vehicles: int = 0) -> None:
        """Begin an episode.

        Args:
            vehicles: number of vehicles of the episode besides the ego, if they come and go; a
                ghost has the next number.
        """
        self._ghost = None
        self._seen = []
        self._vehicles = vehicles

    def perceive(self, now: Observation, dt_s: float, errors: Row) -> tuple[Perception, Point]:
        """Return the planner's perception, and its perceived position of the nearest vehicle.

        Args:
            now: the truth.
            dt_s: duration of a step.
            errors: a_t of each channel, in its unit.
        """
        places = [number - 1 for number in now.numbers]
        actor = places[find_nearest(now.ego, now.others)]
        others = dict(zip(places, now.others, strict=True))
        if self._delays:
            # The delay comes first, so that the errors of this step are added to the old picture.
            self._seen.append(others)
            delay_s = sum(abs(errors[place]) for place in self._delays)
            # At the start there is no earlier picture: the first one stays until the delay is over.
            others = self._seen[max(len(self._seen) - 1 - round(delay_s / dt_s), 0)]
        changed = self._disturb(now.ego, others, actor, errors)
        missed: set[int] = set()
        if self._occlusion:
            # Read from where the vehicles truly are, also under a delay (docs/noise.md, occlusion).
            missed = {places[hidden] for hidden in find_hidden(now.ego, now.others)}
        for place, target in self._misses:
            if errors[place] > 0.5:
                missed.add(actor if target == NEAREST else target)
        seen = {
            number: changed.get(number, other)
            for number, other in others.items()
            if number not in missed
        }
        # Taken before the ghost comes and numbers are swapped: the record shows where the planner
        # sees the nearest vehicle itself, by whatever number.
        position = (seen[actor].x_m, seen[actor].y_m) if actor in seen else NOWHERE
        for place in self._ghosts:
            self._ghost = self._follow_ghost(now.ego) if errors[place] > 0.5 else None
        if self._ghost is not None:
            seen[max(len(now.others), self._vehicles)] = self._ghost
        swapped = any(errors[place] > 0.5 for place in self._swaps)
        exchanged = _exchange_nearest(now) if swapped else {}
        ids = tuple([exchanged.get(number, number) + 1 for number in seen])
        ego = changed.get(EGO, now.ego)
        return Perception(now.step * dt_s, ego, tuple(seen.values()), ids), position

    def _disturb(
        self, ego: VehicleState, others: dict[int, VehicleState], actor: int, errors: Row
    ) -> dict[int, VehicleState]:
        """Return the vehicles, and the ego, whose state is perceived with errors."""
        changed: dict[int, list[float]] = {}
        for place, target, field in self._errors:
            vehicle = actor if target == NEAREST else target
            if vehicle not in changed:
                # The vehicle of this channel has gone, or has not come yet.
                if vehicle != EGO and vehicle not in others:
                    continue
                changed[vehicle] = list_fields(ego if vehicle == EGO else others[vehicle])
            changed[vehicle][field] += errors[place]
        return {vehicle: make_state(fields) for vehicle, fields in changed.items()}

    def _follow_ghost(self, ego: VehicleState) -> VehicleState:
        """Return the ghost, which keeps the position that it had when its event began."""
        if self._ghost is not None:
            return self._ghost
        x_m = ego.x_m + self._ahead_m
        return VehicleState(x_m, ego.y_m, 0.0, 0.0, GHOST_LENGTH_M, GHOST_WIDTH_M)


def _exchange_nearest(now: Observation) -> dict[int, int]:
    """Return a mapping that swaps the two vehicles whose centres are nearest to the ego's.

    It is empty if there is only one vehicle. Behind a bridge, a campaign does not know how many
    there are.
    """
    ego, others = now.ego, now.others
    if len(others) < 2:
        return {}
    apart = [hypot(other.x_m - ego.x_m, other.y_m - ego.y_m) for other in others]
    nearest = sorted(range(len(others)), key=apart.__getitem__)[:2]
    first, second = (now.numbers[place] - 1 for place in nearest)
    return {first: second, second: first}


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
    """Return a vehicle with the given fields; length and width have a minimum."""
    x_m, y_m, heading_rad, speed_mps, length_m, width_m = fields
    return VehicleState(
        x_m,
        y_m,
        heading_rad,
        speed_mps,
        max(length_m, LEAST_SIZE_M),
        max(width_m, LEAST_SIZE_M),
    )
