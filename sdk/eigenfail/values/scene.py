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
"""Kinds of vehicles: categories of vehicles and pedestrians of ASAM OpenSCENARIO XML 1.3."""


# Of numbers alone, which cannot be part of a circle: the garbage collector need not visit the
# thousands that an episode makes.
class VehicleState(msgspec.Struct, frozen=True, gc=False):
    """A vehicle in the plane of the road: position of its centre, heading, speed, footprint."""

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
        lane_0_ends_x_m: x at which lane 0 ends, as a ramp does; None if it goes on.
        peak_braking_mps2: peak deceleration of the ego's brakes; by default the paper's value.
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
    """The view of a planner: the ego and other vehicles, disturbed by the campaign's channels.

    Attributes:
        others: the detected vehicles: all vehicles, unless a channel makes the ego miss one.
        ids: number of each detected vehicle, from 1, constant during the episode.
    """

    time_s: float
    ego: VehicleState
    others: tuple[VehicleState, ...]
    ids: tuple[int, ...]


class LanePosition(msgspec.Struct, frozen=True, gc=False):
    """Position of the ego in the nearest lane.

    Attributes:
        offset_m: offset of the ego's centre from the centre of the lane, positive to the left.
        width_m: width of the lane.
    """

    offset_m: float
    width_m: float


class Observation(msgspec.Struct, frozen=True):
    """The true state after a step, for the tester.

    Attributes:
        step: number of steps taken so far.
        others: every other vehicle that is present; never empty.
        collided: whether the simulator's own test saw the ego touch another vehicle.
        ended: whether the episode is over, by a collision or at its horizon.
        perceived: position at which the ego saw the nearest vehicle in the step just taken [m]; NaN
            if the vehicle was missed.
        control: control that the planner requested in the step just taken.
        applied: control that the truck could apply; None if the simulator does not report it.
        off_road: whether the ego is beyond the edge or the end of its road.
        lane: position of the ego in its lane; None if the simulator does not report it.
        ids: number of each other vehicle, from 1, constant during the episode; None if all vehicles
            are present throughout, in the same order.
        signals: additional signals of the simulator, by name; None without any.
        cause: cause of the collision, if the scenario names one; None without a collision.
        frames: the true states at equally spaced moments within the step just taken, each as
            complete as this one; empty if the simulator only shows the end of a step.
        peak_braking_mps2: peak deceleration of the ego's brakes, only at the start; None if the
            simulator does not report it.
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
            vehicle 0 is the ego. NaN while a vehicle is absent.
        sizes: length and width [m], shape (vehicles, 2).
        perceived: position at which the ego saw the nearest vehicle [m], shape (steps, 2); NaN
            if the vehicle was missed.
        controls: acceleration [m/s²] and steering [rad], shape (steps, 2).
        road: borders of the lanes, each of shape (points, 2) [m]; absent if the simulator does
            not report them.
        kinds: one of `VEHICLE_KINDS` for each vehicle; absent if the simulator does not report
            them.
    """

    dt_s: float
    vehicles: Floats
    sizes: Floats
    perceived: Floats
    controls: Floats
    road: tuple[Floats, ...] | UnsetType = UNSET
    kinds: tuple[str, ...] | UnsetType = UNSET
