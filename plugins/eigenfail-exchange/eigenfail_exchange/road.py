"""The straight road under an episode's vehicles; names, heights and presence of the vehicles."""

from collections.abc import Sequence
from math import ceil, floor

import msgspec
import numpy as np

from eigenfail.contracts.recording import EpisodeRecording
from eigenfail.errors import InvalidValue
from eigenfail.values.scene import Mission, Scene

CONVENTIONAL_LANE_M = 3.5
"""Width of a lane where the scenario does not tell. [m]"""


ROAD_MARGIN_M = 200.0
"""Length of road before the first and behind the last vehicle, for controllers that drive otherwise
than the ego did. [m]"""


TRUCK_LENGTH_M = 8.0
"""Vehicles that are longer than this are called trucks. [m]"""


MAX_LANES = 64
"""Lanes that are laid at most under vehicles of a road that is not known: positions on a bridge are
not bounded."""


_TRUCK_HEIGHT_M, _CAR_HEIGHT_M = 3.8, 1.5


class StraightRoad(msgspec.Struct, frozen=True):
    """Lanes parallel to x, numbered from the right; y is to the left.

    Attributes:
        starts_x_m: x of its beginning.
        ends_x_m: x of its end.
        right_edge_y_m: right edge of lane 0.
        lane_0_ends_x_m: where lane 0 ends; None if it goes on.
        is_known: whether the scenario defines its lanes; otherwise they are made to lie under all
            vehicles.
    """

    starts_x_m: float
    ends_x_m: float
    right_edge_y_m: float
    lanes: int
    lane_width_m: float
    lane_0_ends_x_m: float | None
    is_known: bool

    @property
    def length_m(self) -> float:
        """Length of the road. [m]"""
        return self.ends_x_m - self.starts_x_m

    @property
    def left_edge_y_m(self) -> float:
        """Left edge of the last lane. [m]"""
        return self.right_edge_y_m + self.lanes * self.lane_width_m


def make_road(scenes: Sequence[Scene], mission: Mission | None) -> StraightRoad:
    """Return the road under all vehicles of some scenes.

    Args:
        scenes: at least one.
        mission: lanes of the scenario; None if they are not known.

    Raises:
        InvalidValue: the lanes are not known, and the vehicles are spread too far across the road.
    """
    places = [scene.vehicles[..., :2].reshape(-1, 2).astype(np.float64) for scene in scenes]
    lowest = np.nanmin([np.nanmin(each, axis=0) for each in places], axis=0)
    highest = np.nanmax([np.nanmax(each, axis=0) for each in places], axis=0)
    starts, ends = float(lowest[0]) - ROAD_MARGIN_M, float(highest[0]) + ROAD_MARGIN_M
    if mission is not None:
        half_m = 0.5 * mission.lane_width_m
        shape = mission.lanes, mission.lane_width_m, mission.lane_0_ends_x_m
        return StraightRoad(starts, ends, -half_m, *shape, is_known=True)
    # A lane has its centre at y = 0, as lane 0 has in every world, or would have it there.
    first = floor(float(lowest[1]) / CONVENTIONAL_LANE_M + 0.5)
    last = max(ceil(float(highest[1]) / CONVENTIONAL_LANE_M - 0.5), first)
    lanes = last - first + 1
    if lanes > MAX_LANES:
        reach_m = float(highest[1] - lowest[1])
        problem = f"Its vehicles are up to {reach_m:g} m beside each other, on no known road."
        raise InvalidValue("episode", problem, f"At most {MAX_LANES} lanes are drawn under them.")
    edge = (first - 0.5) * CONVENTIONAL_LANE_M
    return StraightRoad(starts, ends, edge, lanes, CONVENTIONAL_LANE_M, None, is_known=False)


def find_road(recording: EpisodeRecording) -> StraightRoad:
    """Return the road under the vehicles of an episode; raises as `make_road` does."""
    return make_road([recording.scene], recording.mission)


def name_vehicle(number: int) -> str:
    """Return the name of a vehicle by its number in the scene; number 0 is the ego."""
    return f"vehicle_{number}" if number else "ego"


def find_height(length_m: float) -> float:
    """Return the height for drawing a vehicle, since the world does not define heights. [m]"""
    return _TRUCK_HEIGHT_M if length_m > TRUCK_LENGTH_M else _CAR_HEIGHT_M


def find_presence(scene: Scene, vehicle: int) -> list[tuple[int, int]]:
    """Return the first and the last step of each time span during which a vehicle is there."""
    there = np.isfinite(scene.vehicles[:, vehicle, :3]).all(axis=1)
    edges = np.diff(np.concatenate([[0], there.astype(np.int8), [0]]))
    firsts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    return [(int(first), int(end) - 1) for first, end in zip(firsts, ends, strict=True)]
