"""Raw gap acceptance for a driver whose lane ends: one look, no filter.

The safety criterion of Kesting, Treiber, Helbing: General lane-changing model MOBIL for
car-following models, Transportation Research Record 1999 (2007), eq. 2: nobody may be made to
brake harder than b_safe. The driver asks no more of itself. What makes it change is no advantage,
but the end of its lane.
"""

from collections.abc import Callable
from math import inf
from typing import Annotated, NamedTuple

import msgspec
from msgspec import Meta

from eigenfail.values import Mission, Perception, VehicleState

Model = Callable[[float, float, float], float]
"""The acceleration [m/s²] of who drives at a speed [m/s], a gap [m] behind a lead at a speed."""


class GapAcceptanceSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """When a gap is taken."""

    safe_deceleration_mps2: Annotated[
        float,
        Meta(gt=0.0, le=9.0, description="b_safe: nobody has to brake harder [m/s²]."),
    ] = 0.25
    standstill_gap_m: Annotated[
        float, Meta(ge=0.0, le=20.0, description="Gap that is left when that is over [m].")
    ] = 2.0
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
        """Whether all vehicles that seem to be on the main lane leave room."""
        return all(self._leaves_room(ego, other) for other in others if other.y_m > self._line_m)

    def _leaves_room(self, ego: VehicleState, other: VehicleState) -> bool:
        """Whether the ego can follow who is ahead, or is not caught up by who is not."""
        safe_mps2 = self._settings.safe_deceleration_mps2
        gap_m = abs(other.x_m - ego.x_m) - (ego.length_m + other.length_m) / 2.0
        if other.x_m > ego.x_m:
            pace_mps = max(ego.speed_mps, other.speed_mps)
            return self._model(pace_mps, gap_m, other.speed_mps) >= -safe_mps2
        closing_mps = max(other.speed_mps - ego.speed_mps, 0.0)
        braking_m = closing_mps**2 / (2.0 * safe_mps2)
        return gap_m >= self._settings.standstill_gap_m + braking_m
