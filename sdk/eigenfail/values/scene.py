"""The output of a simulator: vehicles at one moment, and the whole course of an episode."""

from collections.abc import Mapping, Sequence
from typing import Final

import msgspec
from msgspec import UNSET, UnsetType

from eigenfail.values.arrays import Floats
from eigenfail.values.showing import Brief

PEAK_BRAKING_MPS2: Final = 7.0
"""Peak braking of the paper's truck. A DRAC above it is a violation."""

UNKNOWN_KIND: Final = "unknown"

VEHICLE_KINDS: Final = (
    "car",
    "van",
    "truck",
    "bus",
    "tram",
    "motorbike",
    "bicycle",
    "pedestrian",
    "animal",
    UNKNOWN_KIND,
)
"""What a vehicle may be: categories of vehicles and pedestrians of ASAM OpenSCENARIO XML 1.3."""


# Of numbers alone, which cannot be part of a circle: the garbage collector need not visit the
# thousands that an episode makes.
class VehicleState(msgspec.Struct, frozen=True, gc=False):
    """One vehicle in the road's plane: position of its centre, heading, speed, footprint."""

    x_m: float
    y_m: float
    heading_rad: float
    speed_mps: float
    length_m: float
    width_m: float


class Control(msgspec.Struct, frozen=True, gc=False):
    """The answer of a planner."""

    acceleration_mps2: float
    steering_rad: float


class Mission(msgspec.Struct, frozen=True):
    """The planner's briefing before it drives: map and task, nothing about the test.

    Lanes are parallel to x; lane 0 has its centre at y = 0, the next at y = lane_width_m.

    Attributes:
        lane_0_ends_x_m: where lane 0 ends, as the lane of a ramp does; None if it goes on.
        peak_braking_mps2: deceleration that the ego's brakes can do; by default the paper's.
    """

    dt_s: float
    lanes: int
    lane_width_m: float
    speed_limit_mps: float
    desired_speed_mps: float
    goal_x_m: float
    lane_0_ends_x_m: float | None = None
    peak_braking_mps2: float = PEAK_BRAKING_MPS2


class Perception(msgspec.Struct, frozen=True):
    """What a planner sees: itself and the others, disturbed by the channels of the campaign.

    Attributes:
        others: the vehicles that are detected: all of them, unless a channel lets one be missed.
        ids: number of each of them, from 1, which it keeps for the whole episode.
    """

    time_s: float
    ego: VehicleState
    others: tuple[VehicleState, ...]
    ids: tuple[int, ...]


class LanePosition(msgspec.Struct, frozen=True, gc=False):
    """Where the ego is in the lane that it is nearest to.

    Attributes:
        offset_m: offset of its centre from the centre of the lane, to the left above 0.
        width_m: width of the lane.
    """

    offset_m: float
    width_m: float


class Observation(msgspec.Struct, frozen=True):
    """The truth after a step, as the tester sees it.

    Attributes:
        step: number of steps taken so far.
        others: every other vehicle that is there; never empty.
        collided: whether the simulator's own test saw the ego touch another vehicle.
        ended: whether the episode is over, by a collision or at its horizon.
        perceived: position at which the ego saw the nearest vehicle in the step just taken [m]; NaN
            if that was missed.
        control: what the planner asked for in the step just taken.
        applied: the part of it that the truck could do; None if the simulator does not report it.
        off_road: whether the ego is beyond the edge or the end of its road.
        lane: where the ego is in its lane; None if the simulator does not tell.
        ids: number of each other vehicle, from 1, which it keeps for the whole episode; None if
            all of them are there throughout, in the same order.
        signals: signals of the simulator's own, by name; None without any.
        cause: cause of the collision, where the scenario names one; None without a collision.
        frames: the truth at equally spaced moments within the step just taken, each as complete as
            this one; empty if the simulator shows the end of a step alone.
        peak_braking_mps2: deceleration that the ego's brakes can do, at the start alone; None if
            the simulator does not tell.
    """

    step: int
    ego: VehicleState
    others: tuple[VehicleState, ...]
    collided: bool = False
    ended: bool = False
    perceived: tuple[float, float] | None = None
    control: Control | None = None
    applied: Control | None = None
    off_road: bool = False
    lane: LanePosition | None = None
    ids: tuple[int, ...] | None = None
    signals: Mapping[str, float] | None = None
    cause: str | None = None
    frames: tuple["Observation", ...] = ()
    peak_braking_mps2: float | None = None

    @property
    def numbers(self) -> Sequence[int]:
        """Number of each other vehicle, from 1."""
        return range(1, len(self.others) + 1) if self.ids is None else self.ids


class Scene(Brief, msgspec.Struct, frozen=True, eq=False):
    """The course of one episode.

    Attributes:
        dt_s: time between two steps.
        vehicles: x [m], y [m], heading [rad], speed [m/s], shape (steps + 1, vehicles, 4);
            vehicle 0 is the ego. NaN while a vehicle is not there.
        sizes: length and width [m], shape (vehicles, 2).
        perceived: position at which the ego saw the nearest vehicle [m], shape (steps, 2); NaN
            if that was missed.
        controls: acceleration [m/s²] and steering [rad], shape (steps, 2).
        road: borders of the lanes, each of shape (points, 2) [m]; absent if the simulator does
            not show them.
        kinds: one of `VEHICLE_KINDS` for each vehicle; absent if the simulator tells none.
    """

    dt_s: float
    vehicles: Floats
    sizes: Floats
    perceived: Floats
    controls: Floats
    road: tuple[Floats, ...] | UnsetType = UNSET
    kinds: tuple[str, ...] | UnsetType = UNSET
