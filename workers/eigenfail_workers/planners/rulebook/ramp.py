"""A lane that ends, as the truck sees it that has to leave it."""

from typing import Annotated

import msgspec
from msgspec import Meta

from eigenfail.values import Mission, VehicleState
from eigenfail_workers.planners.rulebook.candidates import CandidateSettings
from eigenfail_workers.planners.rulebook.changes import ChangePlanner, ChangeSettings
from eigenfail_workers.planners.rulebook.gaps import GapFinder, GapSettings
from eigenfail_workers.planners.rulebook.lanes import LaneHeld
from eigenfail_workers.planners.rulebook.lateral import LateralPath, change_way_m
from eigenfail_workers.planners.rulebook.surroundings import Neighbour, required_deceleration
from eigenfail_workers.planners.rulebook.truck import TruckLimits


class MergeSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How the truck leaves a lane that ends.

    Attributes:
        commit: steps in a row that a gap must fit before the change begins, and steps in a row
            that another candidate must be ahead by progress alone before the truck turns to it.
    """

    gaps: GapSettings = GapSettings()
    changes: ChangeSettings = ChangeSettings()
    commit: Annotated[int, Meta(ge=1, le=100)] = 5


class Ramp:
    """The lane that ends, and what all phases of leaving it have in common."""

    def __init__(
        self,
        ends_x_m: float,
        settings: MergeSettings,
        mission: Mission,
        candidates: CandidateSettings,
        limits: TruckLimits,
    ) -> None:
        width_m = mission.lane_width_m
        self._ends_x_m = ends_x_m
        self._line_m = 0.5 * width_m
        self.settings = settings
        self.mission = mission
        self.candidates = candidates
        self.limits = limits
        self.finder = GapFinder(settings.gaps, width_m, width_m, mission.dt_s)
        self.planner = ChangePlanner(settings.changes, candidates, limits)

    def end(self, ego: VehicleState) -> Neighbour:
        """The end of the lane, as if somebody stood there."""
        return Neighbour(self._ends_x_m - ego.x_m - 0.5 * ego.length_m, 0.0, 0.0)

    def is_left(self, ego: VehicleState) -> bool:
        """Whether the truck is in the next lane."""
        return ego.y_m > self._line_m

    def held(self) -> LaneHeld:
        """What follows in a lane that goes on."""
        return LaneHeld(self.mission, self.candidates, self.limits)

    def can_turn_back(self, ego: VehicleState) -> bool:
        """Until its side crosses the line, and if it can still stop comfortably after that."""
        margin_m = self.candidates.turning_room_m
        need = required_deceleration(self.end(ego).gap_m, ego.speed_mps, margin_m)
        is_inside = ego.y_m + 0.5 * ego.width_m < self._line_m
        return is_inside and need <= self.limits.comfort_braking_mps2

    def path(self, ego: VehicleState, to_m: float) -> LateralPath:
        """A path that begins here."""
        way_m = change_way_m(ego.speed_mps, self.settings.changes.lateral)
        return LateralPath(ego.y_m, to_m, ego.x_m, way_m)
