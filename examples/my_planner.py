"""A planner of one's own: keeps a time gap to a smoothed lead, and says why. docs/own_planner.md"""

from typing import Annotated

import msgspec
from msgspec import Meta

from eigenfail.values.proof import Account
from eigenfail.values.scene import Control, Mission, Perception, VehicleState


class MySettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What a campaign may set under `planner_settings`; what is outside the bounds is refused."""

    time_gap_s: Annotated[float, Meta(ge=0.5, le=5.0, description="Gap to keep [s].")] = 2.0
    smoothing: Annotated[float, Meta(gt=0.0, le=1.0, description="Weight of a new gap.")] = 0.3
    braking_mps2: Annotated[float, Meta(gt=0.0, le=9.0, description="Hardest braking.")] = 6.0


class MyPlanner:
    """Implements `Planner` and, since it has `explain`, `ExplainingPlanner`."""

    Settings = MySettings

    def __init__(self, settings: MySettings) -> None:
        self._settings = settings

    def reset(self, mission: Mission) -> None:
        """Forget everything: a new episode begins."""
        self._mission = mission
        self._gap_m: float | None = None
        self._closing_mps = 0.0

    def act(self, perception: Perception) -> Control:
        """Seek the desired speed; behind somebody, the time gap and an equal speed."""
        ego = perception.ego
        wanted = 0.4 * (self._mission.desired_speed_mps - ego.speed_mps)
        ahead = [other for other in perception.others if self._may_lead(ego, other)]
        self._look_at(ego, min(ahead, key=lambda other: other.x_m, default=None))
        if self._gap_m is not None:
            missing_m = self._gap_m - self._settings.time_gap_s * ego.speed_mps
            wanted = min(wanted, 0.1 * missing_m - 0.6 * self._closing_mps)
        return Control(min(max(wanted, -self._settings.braking_mps2), 1.0), 0.0)

    def explain(self) -> Account:
        """An account of the last step, for `eigenfail episode explain`; no planner needs it."""
        if self._gap_m is None:
            return {"heeds": "nobody"}
        return {"heeds": "lead", "gap_m": self._gap_m, "closing_mps": self._closing_mps}

    def _may_lead(self, ego: VehicleState, other: VehicleState) -> bool:
        return other.x_m > ego.x_m and abs(other.y_m - ego.y_m) < self._mission.lane_width_m * 0.75

    def _look_at(self, ego: VehicleState, lead: VehicleState | None) -> None:
        if lead is None:
            self._gap_m = None
            return
        seen_m = lead.x_m - ego.x_m - (ego.length_m + lead.length_m) / 2.0
        before_m = seen_m if self._gap_m is None else self._gap_m
        self._gap_m = before_m + self._settings.smoothing * (seen_m - before_m)
        self._closing_mps = ego.speed_mps - lead.speed_mps
