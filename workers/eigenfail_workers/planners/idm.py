"""The Intelligent Driver Model on raw perception: the paper's baseline.

Treiber, Hennecke, Helbing: Congested traffic states in empirical observations and microscopic
simulations, Physical Review E 62 (2000), eq. 2 and 3.
"""

from collections.abc import Callable
from math import inf, sqrt
from typing import Annotated, NamedTuple

import msgspec
from msgspec import Meta

from eigenfail.values.scene import Control, Mission, Perception, VehicleState
from eigenfail_workers.planners.steering import LaneKeeping, pursue

CarFollowingModel = Callable[[float, float, float], float]
"""Acceleration [m/s²] at a speed [m/s] and a gap [m] behind a lead with its own speed [m/s]."""

STEP_S = 0.5


def least_gap_behind(
    ego: VehicleState,
    lead: VehicleState | None,
    follower: VehicleState,
    model: CarFollowingModel,
    foresight_s: float,
) -> float:
    """Least predicted gap between the ego and its follower. [m]

    In steps of half a second, the ego follows its lead by its model, and all others keep their
    speed. An ego that merges closer than its model prefers falls back, and the follower needs room
    for that.

    Args:
        ego: the vehicle that decides.
        lead: the vehicle that it will follow; None on a free road.
        follower: the vehicle that will follow it.
        model: model of the ego.
        foresight_s: horizon of the prediction.
    """
    gap = least = gap_m(follower, ego)
    room = inf if lead is None else gap_m(ego, lead)
    speed = ego.speed_mps
    pace = speed if lead is None else lead.speed_mps
    for _ in range(round(foresight_s / STEP_S)):
        speed = max(speed + model(speed, room, pace) * STEP_S, 0.0)
        gap += (speed - follower.speed_mps) * STEP_S
        room += (pace - speed) * STEP_S
        least = min(least, gap)
    return least


def gap_m(rear: VehicleState, front: VehicleState) -> float:
    """Distance from the front bumper of one vehicle to the rear bumper of another. [m]"""
    return front.x_m - rear.x_m - (rear.length_m + front.length_m) / 2.0


class GapAcceptanceSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Thresholds of the acceptance of gaps."""

    safe_deceleration_mps2: Annotated[
        float,
        Meta(gt=0.0, le=9.0, description="b_safe: largest own braking to follow a lead [m/s²]."),
    ] = 0.5
    gap_behind_m: Annotated[
        float, Meta(ge=0.0, le=20.0, description="Least gap to a vehicle behind [m].")
    ] = 2.0
    foresight_s: Annotated[float, Meta(gt=0.0, le=60.0, description="Horizon of that gap [s].")] = (
        20.0
    )
    turning_room_m: Annotated[
        float, Meta(ge=0.0, le=200.0, description="Distance to the end of the lane at a stop [m].")
    ] = 40.0


class LaneEndPlan(NamedTuple):
    """Lane to steer to, and distance to a stop.

    Attributes:
        centre_m: centre of the lane.
        room_m: distance from the front bumper to the point at which the ego must stop in its lane.
    """

    centre_m: float
    room_m: float


class GapAcceptance:
    """Merges from a lane that ends: decides on one perception without a filter, and never revises.

    After the safety criterion of Kesting, Treiber, Helbing: General lane-changing model MOBIL for
    car-following models, Transportation Research Record 1999 (2007), eq. 2. Here no vehicle behind
    may have to brake at all, and the reason for the change is the end of the lane, not an
    advantage.

    Args:
        settings: thresholds.
        mission: mission of the ego.
        model: car-following model of the ego.
    """

    def __init__(
        self, settings: GapAcceptanceSettings, mission: Mission, model: CarFollowingModel
    ) -> None:
        self._settings = settings
        self._mission = mission
        self._line_m = 0.5 * mission.lane_width_m
        self._model = model
        self._decided = False

    def __call__(self, perception: Perception) -> LaneEndPlan | None:
        """Return the plan for the end of the lane; None in a lane that goes on."""
        ego, ends_x_m = perception.ego, self._mission.lane_0_ends_x_m
        if ends_x_m is None or ego.y_m > self._line_m:
            return None
        self._decided = self._decided or self._accepts(ego, perception.others)
        if self._decided:
            return LaneEndPlan(self._mission.lane_width_m, inf)
        front_x_m = ego.x_m + 0.5 * ego.length_m
        return LaneEndPlan(0.0, ends_x_m - self._settings.turning_room_m - front_x_m)

    def _accepts(self, ego: VehicleState, others: tuple[VehicleState, ...]) -> bool:
        """Return whether the ego can follow all vehicles ahead on the main lane and hinder none."""
        there = [other for other in others if other.y_m > self._line_m]
        ahead = [other for other in there if other.x_m > ego.x_m]
        behind = [other for other in there if other.x_m <= ego.x_m]
        lead = min(ahead, key=lambda other: other.x_m, default=None)
        return all(self._can_follow(ego, other) for other in ahead) and all(
            self._stays_clear(ego, lead, other) for other in behind
        )

    def _can_follow(self, ego: VehicleState, lead: VehicleState) -> bool:
        wanted = self._model(max(ego.speed_mps, lead.speed_mps), gap_m(ego, lead), lead.speed_mps)
        return wanted >= -self._settings.safe_deceleration_mps2

    def _stays_clear(
        self, ego: VehicleState, lead: VehicleState | None, follower: VehicleState
    ) -> bool:
        """Return whether a follower at constant speed keeps at least the required gap."""
        foreseen_m = least_gap_behind(ego, lead, follower, self._model, self._settings.foresight_s)
        return foreseen_m >= self._settings.gap_behind_m


# A gap of noise may be 0 or less. The interaction is that of a short gap then, and stays finite.
CONTACT_M = 0.1


class IdmSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of the model, with the symbols of its paper."""

    max_acceleration_mps2: Annotated[
        float, Meta(gt=0.0, le=3.0, description="a: acceleration of a free start [m/s²].")
    ] = 0.8
    comfortable_deceleration_mps2: Annotated[
        float, Meta(gt=0.0, le=5.0, description="b: comfortable deceleration [m/s²].")
    ] = 2.0
    max_deceleration_mps2: Annotated[
        float, Meta(gt=0.0, le=9.0, description="No braking beyond this [m/s²].")
    ] = 7.0
    brake_build_up_mps3: Annotated[
        float, Meta(gt=0.0, le=1e3, description="No braking grows faster than this [m/s³].")
    ] = 10.0
    time_headway_s: Annotated[float, Meta(ge=0.5, le=5.0, description="T: time headway [s].")] = 1.5
    standstill_gap_m: Annotated[
        float, Meta(gt=0.0, le=20.0, description="s0: gap in standing traffic [m].")
    ] = 2.0
    exponent: Annotated[float, Meta(ge=1.0, le=10.0, description="delta: free-road exponent.")] = (
        4.0
    )
    # Half the widths of truck and car together: nearer than this their footprints overlap
    # laterally.
    lane_half_width_m: Annotated[
        float,
        Meta(gt=0.0, le=3.5, description="A vehicle this near to the ego's line is its lead [m]."),
    ] = 2.25
    gaps: GapAcceptanceSettings = GapAcceptanceSettings()


class IntelligentDriver:
    """Follows the nearest perceived vehicle in its lane; no filter, no plan."""

    Settings = IdmSettings

    def __init__(self, settings: IdmSettings) -> None:
        self._settings = settings

    def reset(self, mission: Mission) -> None:
        """Begin a new episode."""
        self._desired_speed_mps = min(mission.desired_speed_mps, mission.speed_limit_mps)
        self._dt_s = mission.dt_s
        self._acceleration_mps2 = 0.0
        self._lane_keeping = LaneKeeping(mission)
        self._gap_acceptance = GapAcceptance(self._settings.gaps, mission, self._behind)

    def act(self, perception: Perception) -> Control:
        """Return the model's control towards the lead in the present perception."""
        ego = perception.ego
        acceleration = self._free(ego.speed_mps)
        gaps = [
            (gap_m(ego, other), other) for other in perception.others if self._leads(ego, other)
        ]
        if gaps:
            gap, lead = min(gaps, key=lambda pair: pair[0])
            acceleration -= self._interaction(ego.speed_mps, gap, lead.speed_mps)
        course = self._gap_acceptance(perception)
        if course is None:
            return Control(self._bounded(acceleration), self._lane_keeping(ego))
        to_a_stop = self._behind(ego.speed_mps, course.room_m, 0.0)
        return Control(self._bounded(min(acceleration, to_a_stop)), pursue(ego, course.centre_m))

    def _bounded(self, acceleration: float) -> float:
        """Return the acceleration that the brakes allow: slow to build up, at once released."""
        settings = self._settings
        # Brakes build up from 0: there is nothing to release first when the truck was accelerating.
        built_up = min(self._acceleration_mps2, 0.0) - settings.brake_build_up_mps3 * self._dt_s
        self._acceleration_mps2 = max(acceleration, built_up, -settings.max_deceleration_mps2)
        return self._acceleration_mps2

    def _leads(self, ego: VehicleState, other: VehicleState) -> bool:
        return other.x_m > ego.x_m and abs(other.y_m - ego.y_m) < self._settings.lane_half_width_m

    def _behind(self, speed_mps: float, gap: float, lead_speed_mps: float) -> float:
        """Return the model's acceleration behind a lead; on a free road the gap is infinite."""
        return self._free(speed_mps) - self._interaction(speed_mps, gap, lead_speed_mps)

    def _free(self, speed_mps: float) -> float:
        settings = self._settings
        share = max(speed_mps, 0.0) / self._desired_speed_mps
        return float(settings.max_acceleration_mps2 * (1.0 - share**settings.exponent))

    def _interaction(self, speed_mps: float, gap: float, lead_speed_mps: float) -> float:
        """Return a (s* / s)², with s* = s0 + v T + v dv / (2 sqrt(a b))."""
        settings = self._settings
        comfort = sqrt(settings.max_acceleration_mps2 * settings.comfortable_deceleration_mps2)
        closing_mps = speed_mps - lead_speed_mps
        dynamic_m = speed_mps * (settings.time_headway_s + closing_mps / (2.0 * comfort))
        wanted_m = settings.standstill_gap_m + max(dynamic_m, 0.0)
        return float(settings.max_acceleration_mps2 * (wanted_m / max(gap, CONTACT_M)) ** 2)
