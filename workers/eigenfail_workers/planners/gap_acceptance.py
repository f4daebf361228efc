"""Raw gap acceptance for a driver whose lane ends: one look, no filter.

In the spirit of the safety criterion of Kesting, Treiber, Helbing: General lane-changing model
MOBIL for car-following models, Transportation Research Record 1999 (2007), eq. 2: here nobody
behind may have to brake at all. What makes the driver change is no advantage, but the end of its
lane.
"""

from math import inf
from typing import Annotated, NamedTuple

import msgspec
from msgspec import Meta

from eigenfail.values import Mission, Perception, VehicleState
from eigenfail_workers.planners.foresight import Model, gap_m, least_gap_behind


class GapAcceptanceSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """When a gap is taken."""

    safe_deceleration_mps2: Annotated[
        float,
        Meta(gt=0.0, le=9.0, description="b_safe: it asks no more of itself [m/s²]."),
    ] = 0.5
    gap_behind_m: Annotated[
        float, Meta(ge=0.0, le=20.0, description="Gap that who follows always keeps [m].")
    ] = 2.0
    foresight_s: Annotated[
        float, Meta(gt=0.0, le=60.0, description="How far ahead that is foreseen [s].")
    ] = 20.0
    turning_room_m: Annotated[
        float, Meta(ge=0.0, le=200.0, description="Stop this long before the lane ends [m].")
    ] = 40.0


class Course(NamedTuple):
    """Where to steer, and how far it is to a standstill.

    Attributes:
        centre_m: of the lane to be in.
        room_m: from the front bumper to where the ego must stand if it stays in its lane.
    """

    centre_m: float
    room_m: float


class GapAcceptance:
    """Decides on what is perceived at one step, and goes through with it.

    Args:
        model: how the ego follows a lead.
    """

    def __init__(self, settings: GapAcceptanceSettings, mission: Mission, model: Model) -> None:
        self._settings = settings
        self._mission = mission
        self._line_m = 0.5 * mission.lane_width_m
        self._model = model
        self._decided = False

    def __call__(self, perception: Perception) -> Course | None:
        """What to do about the end of the lane; None in a lane that goes on."""
        ego, ends_x_m = perception.ego, self._mission.lane_0_ends_x_m
        if ends_x_m is None or ego.y_m > self._line_m:
            return None
        self._decided = self._decided or self._accepts(ego, perception.others)
        if self._decided:
            return Course(self._mission.lane_width_m, inf)
        front_x_m = ego.x_m + 0.5 * ego.length_m
        return Course(0.0, ends_x_m - self._settings.turning_room_m - front_x_m)

    def _accepts(self, ego: VehicleState, others: tuple[VehicleState, ...]) -> bool:
        """Whether it can follow all who seem ahead on the main lane, and hinders none behind."""
        there = [other for other in others if other.y_m > self._line_m]
        ahead = [other for other in there if other.x_m > ego.x_m]
        behind = [other for other in there if other.x_m <= ego.x_m]
        lead = min(ahead, key=lambda other: other.x_m, default=None)
        return all(self._can_follow(ego, other) for other in ahead) and all(
            self._stays_clear(ego, lead, other) for other in behind
        )

    def _can_follow(self, ego: VehicleState, lead: VehicleState) -> bool:
        pace_mps = max(ego.speed_mps, lead.speed_mps)
        wanted = self._model(pace_mps, gap_m(ego, lead), lead.speed_mps)
        return wanted >= -self._settings.safe_deceleration_mps2

    def _stays_clear(
        self, ego: VehicleState, lead: VehicleState | None, follower: VehicleState
    ) -> bool:
        """Whether a follower that keeps its speed keeps the gap too, whatever the ego will do."""
        foreseen_m = least_gap_behind(ego, lead, follower, self._model, self._settings.foresight_s)
        return foreseen_m >= self._settings.gap_behind_m
