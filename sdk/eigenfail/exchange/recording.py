"""The course of an episode as other tools need it: poses in time, road, noise and outcome."""

from collections.abc import Sequence
from enum import StrEnum
from math import ceil, floor

import msgspec
import numpy as np

from eigenfail.errors import InvalidValue
from eigenfail.values import Mission, NoiseTrajectory, Outcome, Scene
from eigenfail.values.showing import Brief

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


class RecordingFormat(StrEnum):
    """Format of the file of a single episode.

    `openscenario` is a ZIP archive of scenario, road and noise; `mcap` is a log for Foxglove;
    `gif` is an animation.
    """

    OPENSCENARIO = "openscenario"
    MCAP = "mcap"
    GIF = "gif"

    @property
    def suffix(self) -> str:
        """Ending of the file's name."""
        return ".zip" if self is RecordingFormat.OPENSCENARIO else f".{self.value}"


class EgoControl(StrEnum):
    """Control of the ego in a scenario: its recorded course, or a controller of the simulator."""

    RECORDED = "recorded"
    CONTROLLER = "controller"


class StraightRoad(msgspec.Struct, frozen=True):
    """Lanes parallel to x, numbered from the right; y is to the left.

    Attributes:
        starts_x_m: where it begins.
        ends_x_m: where it ends.
        right_edge_y_m: right edge of lane 0.
        lane_0_ends_x_m: where lane 0 ends; None if it goes on.
        is_known: whether the scenario tells its lanes; otherwise they are made to lie under all
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
        mission: lanes of the scenario; None where they are not known.

    Raises:
        InvalidValue: the lanes are not known, and the vehicles are too far beside each other.
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


class EpisodeRecording(Brief, msgspec.Struct, frozen=True, eq=False, kw_only=True):
    """The course of one episode, to be written as a file of another tool.

    Attributes:
        campaign: id of the campaign.
        recorded_ms: when its campaign was created, in ms since 1970.
        scenario: name of the scenario.
        planner: name of the planner that drove the ego.
        digest: SHA-256 of what happened.
        channels: names of the channels of the noise, in the order of its columns.
        mission: lanes of the scenario; None where they are not known.
    """

    campaign: int
    campaign_name: str
    index: int
    recorded_ms: int
    scenario: str
    planner: str
    seed: int
    outcome: Outcome
    digest: str
    noise: NoiseTrajectory
    channels: tuple[str, ...]
    scene: Scene
    mission: Mission | None = None

    @property
    def name(self) -> str:
        """Name of the episode as that of a file, without its ending."""
        return f"episode-{self.campaign}-{self.index}"

    @property
    def title(self) -> str:
        """What the file shows, in words."""
        return f"Episode {self.campaign}/{self.index}: {self.outcome.word}"

    @property
    def road(self) -> StraightRoad:
        """The road under its vehicles."""
        return make_road([self.scene], self.mission)


class OverlaidRecordings(Brief, msgspec.Struct, frozen=True, eq=False, kw_only=True):
    """Episodes of one failure mode, to be drawn over each other.

    Attributes:
        title: what they are, in words.
        scenes: courses of the episodes, all with the same time step; the first is the one that
            the view follows.
        total: episodes of the mode, of which the scenes may be a sample.
        mission: lanes of the scenario; None where they are not known.
        aligned_at_end: whether they are aligned at their last step, and not at their first.
        episodes: campaign and index of each, in the order of the scenes; empty if not told.
        has_medoid: whether the first one is the medoid of the mode, whose scene may be missing.
    """

    title: str
    scenes: tuple[Scene, ...]
    outcomes: tuple[Outcome, ...]
    total: int
    mission: Mission | None = None
    aligned_at_end: bool = False
    episodes: tuple[tuple[int, int], ...] = ()
    has_medoid: bool = True


def name_vehicle(number: int) -> str:
    """Return the name of a vehicle by its number in the scene, of which 0 is the ego."""
    return f"vehicle_{number}" if number else "ego"


def find_height(length_m: float) -> float:
    """Return the height by which a vehicle is shown, since the world has none. [m]"""
    return _TRUCK_HEIGHT_M if length_m > TRUCK_LENGTH_M else _CAR_HEIGHT_M


def find_presence(scene: Scene, vehicle: int) -> list[tuple[int, int]]:
    """Return the first and the last step of each time span during which a vehicle is there."""
    there = np.isfinite(scene.vehicles[:, vehicle, :3]).all(axis=1)
    edges = np.diff(np.concatenate([[0], there.astype(np.int8), [0]]))
    firsts, ends = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1)
    return [(int(first), int(end) - 1) for first, end in zip(firsts, ends, strict=True)]
