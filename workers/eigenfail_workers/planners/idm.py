"""The Intelligent Driver Model on raw perception: the paper's baseline.

Treiber, Hennecke, Helbing: Congested traffic states in empirical observations and microscopic
simulations, Physical Review E 62 (2000), eq. 2 and 3.
"""

from math import sqrt
from typing import Annotated

import msgspec
from msgspec import Meta

from eigenfail.values import Control, Mission, Perception, VehicleState
from eigenfail_workers.planners.foresight import gap_m
from eigenfail_workers.planners.gap_acceptance import GapAcceptance, GapAcceptanceSettings
from eigenfail_workers.planners.steering import LaneKeeping, pursue

CONTACT_M = 0.1


class IdmSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """The model's parameters, named as in its paper where it names them."""

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
        """A new episode begins."""
        self._desired_speed_mps = min(mission.desired_speed_mps, mission.speed_limit_mps)
        self._dt_s = mission.dt_s
        self._acceleration_mps2 = 0.0
        self._lane_keeping = LaneKeeping(mission)
        self._gap_acceptance = GapAcceptance(self._settings.gaps, mission, self._behind)

    def act(self, perception: Perception) -> Control:
        """The model's acceleration towards the lead that is perceived at this moment."""
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
        """What the brakes give of it: they take time to build up, and let go at once."""
        settings = self._settings
        built_up = min(self._acceleration_mps2, 0.0) - settings.brake_build_up_mps3 * self._dt_s
        self._acceleration_mps2 = max(acceleration, built_up, -settings.max_deceleration_mps2)
        return self._acceleration_mps2

    def _leads(self, ego: VehicleState, other: VehicleState) -> bool:
        aside_m = abs(other.y_m - ego.y_m)
        return other.x_m > ego.x_m and aside_m < self._settings.lane_half_width_m

    def _behind(self, speed_mps: float, gap: float, lead_speed_mps: float) -> float:
        """The model's acceleration behind a lead; on a free road the gap is infinite."""
        return self._free(speed_mps) - self._interaction(speed_mps, gap, lead_speed_mps)

    def _free(self, speed_mps: float) -> float:
        settings = self._settings
        share = max(speed_mps, 0.0) / self._desired_speed_mps
        return float(settings.max_acceleration_mps2 * (1.0 - share**settings.exponent))

    def _interaction(self, speed_mps: float, gap: float, lead_speed_mps: float) -> float:
        """a (s* / s)², with s* = s0 + v T + v dv / (2 sqrt(a b))."""
        settings = self._settings
        comfort = sqrt(settings.max_acceleration_mps2 * settings.comfortable_deceleration_mps2)
        closing_mps = speed_mps - lead_speed_mps
        dynamic_m = speed_mps * (settings.time_headway_s + closing_mps / (2.0 * comfort))
        wanted_m = settings.standstill_gap_m + max(dynamic_m, 0.0)
        return float(settings.max_acceleration_mps2 * (wanted_m / max(gap, CONTACT_M)) ** 2)
