"""The lateral task: stay in the lane, or leave a lane that ends through a gap of the next one."""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from typing import ClassVar

from eigenfail.values.scene import Mission, VehicleState
from eigenfail_workers.planners.rulebook import values
from eigenfail_workers.planners.rulebook.candidates import hold, roll_out, roll_out_all, stop
from eigenfail_workers.planners.rulebook.changes import (
    ChangePlanner,
    change_way_m,
    make_straight_path,
)
from eigenfail_workers.planners.rulebook.rules import progress
from eigenfail_workers.planners.rulebook.settings import (
    CandidateSettings,
    MergeSettings,
    TruckLimits,
)
from eigenfail_workers.planners.rulebook.tracker import Track
from eigenfail_workers.planners.rulebook.traffic import (
    GapFinder,
    find_nearer,
    required_deceleration,
)
from eigenfail_workers.planners.steering import LaneKeeping, look_ahead_m, pursue


class LanePlanner(ABC):
    """One phase of the lateral task: in each step observe, propose, decide, steer.

    Attributes:
        phase: its name.
    """

    phase: ClassVar[values.LanePhase]

    @abstractmethod
    def observe(
        self, tracks: Sequence[Track], ego: VehicleState, traffic: values.Traffic, /
    ) -> values.Traffic:
        """Return the traffic with what this phase adds to it."""

    @abstractmethod
    def propose(self, start: values.PlanStart, traffic: values.Traffic, /) -> list[values.Profile]:
        """Return the candidates."""

    @abstractmethod
    def decide(
        self,
        choice: values.RuleChoice,
        offered: Sequence[values.Profile],
        ego: VehicleState,
        /,
    ) -> tuple[values.RuleChoice, "LanePlanner"]:
        """Return the choice, which the phase may change, and the next phase."""

    @abstractmethod
    def steer(self, ego: VehicleState, /) -> float:
        """Return the steering angle. [rad]"""

    @abstractmethod
    def lateral_m(self, ego: VehicleState, x_m: float, /) -> float:
        """Return the planned lateral position at a position along the road. [m]"""


class InLane(LanePlanner):
    """Stays in the lane at its begin."""

    phase: ClassVar[values.LanePhase] = values.LanePhase.IN_LANE

    def __init__(
        self, mission: Mission, candidates: CandidateSettings, limits: TruckLimits
    ) -> None:
        self._candidates = candidates
        self._limits = limits
        self._lane_keeping = LaneKeeping(mission)

    def observe(
        self, _tracks: Sequence[Track], _ego: VehicleState, traffic: values.Traffic, /
    ) -> values.Traffic:
        """Return the traffic: a lane that goes on adds nothing."""
        return traffic

    def propose(self, start: values.PlanStart, traffic: values.Traffic, /) -> list[values.Profile]:
        """Return the candidates that stay in their lane."""
        return roll_out_all(start, traffic, self._candidates, self._limits)

    def decide(
        self,
        choice: values.RuleChoice,
        _offered: Sequence[values.Profile],
        _ego: VehicleState,
        /,
    ) -> tuple[values.RuleChoice, LanePlanner]:
        """Return the choice of the rules."""
        return choice, self

    def steer(self, ego: VehicleState, /) -> float:
        """Return the steering angle to the centre of the lane. [rad]"""
        return self._lane_keeping(ego)

    def lateral_m(self, ego: VehicleState, _x_m: float, /) -> float:
        """Return the centre of the lane. [m]"""
        return self._lane_keeping.centre_m(ego)


class EndingLane:
    """A lane that ends, with the parts that all phases of leaving it share."""

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

    def find_end(self, ego: VehicleState) -> values.Neighbour:
        """Return the end of the lane, as a standing vehicle."""
        return values.Neighbour(self._ends_x_m - ego.x_m - 0.5 * ego.length_m, 0.0, 0.0)

    def is_left(self, ego: VehicleState) -> bool:
        """Return whether the truck is in the next lane."""
        return ego.y_m > self._line_m

    def make_in_lane(self) -> InLane:
        """Return the phase in a lane that goes on."""
        return InLane(self.mission, self.candidates, self.limits)

    def can_turn_back(self, ego: VehicleState) -> bool:
        """Return whether the truck can still stay in its lane.

        Its side must not have crossed the line, and it must be able to stop comfortably before the
        end of the lane.
        """
        margin_m = self.candidates.turning_room_m
        need = required_deceleration(self.find_end(ego).gap_m, ego.speed_mps, margin_m)
        is_inside = ego.y_m + 0.5 * ego.width_m < self._line_m
        return is_inside and need <= self.limits.comfort_braking_mps2

    def make_path(self, ego: VehicleState, to_m: float) -> values.LateralPath:
        """Return a path from the truck to a lateral position."""
        way_m = change_way_m(ego.speed_mps, self.settings.changes.lateral)
        return values.LateralPath(ego.y_m, to_m, ego.x_m, way_m)


ABORT = "abort"
COMMITMENT = "commitment"
"""Deciding rule where the truck keeps its previous candidate."""


class PathFollower(LanePlanner):
    """Steers along a path across the road."""

    def __init__(self, path: values.LateralPath) -> None:
        self._path = path

    def steer(self, ego: VehicleState, /) -> float:
        """Return the steering angle to the path ahead. [rad]"""
        return pursue(ego, self.lateral_m(ego, ego.x_m + look_ahead_m(ego)))

    def lateral_m(self, _ego: VehicleState, x_m: float, /) -> float:
        """Return the lateral position on the path. [m]"""
        return self._path.at(x_m)


class ApproachingGap(PathFollower):
    """Approaches a gap, in the lane that ends.

    Args:
        ramp: the lane that ends.
        path: path to the centre of that lane, to which a change may have been aborted.
    """

    phase: ClassVar[values.LanePhase] = values.LanePhase.APPROACHING

    def __init__(self, ramp: EndingLane, path: values.LateralPath) -> None:
        super().__init__(path)
        self._ramp = ramp
        self._name = ""
        self._rival_steps = 0
        self._ready_steps = 0

    def observe(
        self, tracks: Sequence[Track], ego: VehicleState, traffic: values.Traffic, /
    ) -> values.Traffic:
        """Return the traffic with the end of the lane and the gaps of the next one."""
        if self._ramp.is_left(ego):
            return traffic
        gaps = self._ramp.finder.find_gaps(tracks, ego)
        return values.Traffic(traffic.lead, traffic.neighbour, self._ramp.find_end(ego), gaps)

    def propose(self, start: values.PlanStart, traffic: values.Traffic, /) -> list[values.Profile]:
        """Return a candidate for each gap, and those that stay in the lane."""
        plan_change = self._ramp.planner.plan_change
        changes = [plan_change(name, gap, start) for name, gap in traffic.gaps.items()]
        return changes + roll_out_all(start, traffic, self._ramp.candidates, self._ramp.limits)

    def decide(
        self,
        choice: values.RuleChoice,
        offered: Sequence[values.Profile],
        ego: VehicleState,
        /,
    ) -> tuple[values.RuleChoice, LanePlanner]:
        """Keep a choice for some steps; begin the change when its gap has fitted long enough."""
        if self._ramp.is_left(ego):
            return choice, self._ramp.make_in_lane()
        choice = self._keep_choice(choice, offered)
        self._name, change = choice.profile.name, choice.profile.change
        fits = change is not None and change.begins == 0
        self._ready_steps = self._ready_steps + 1 if fits else 0
        if self._ready_steps < self._ramp.settings.commit:
            return choice, self
        return choice, ChangingLane(self._ramp, self._name, ego)

    def _keep_choice(
        self, choice: values.RuleChoice, offered: Sequence[values.Profile]
    ) -> values.RuleChoice:
        """Return the rules' choice; a new one by progress alone only after some steps in a row."""
        before = [profile for profile in offered if profile.name == self._name]
        is_rival = choice.rule == progress.__name__ and choice.profile.name != self._name
        self._rival_steps = self._rival_steps + 1 if before and is_rival else 0
        # Two gaps may promise about the same progress, and noise decides which is better: without
        # this the truck would turn from one to the other. Safety rules are obeyed at once.
        if 0 < self._rival_steps < self._ramp.settings.commit:
            return values.RuleChoice(before[0], COMMITMENT)
        self._rival_steps = 0
        return choice


class ChangingLane(PathFollower):
    """Changes into the next lane, or turns back."""

    phase: ClassVar[values.LanePhase] = values.LanePhase.CHANGING

    def __init__(self, ramp: EndingLane, name: str, ego: VehicleState) -> None:
        super().__init__(ramp.make_path(ego, ramp.mission.lane_width_m))
        self._ramp = ramp
        self._name = name
        self._left_m = self._path.length_m
        # Overwritten by `observe`, which comes before `propose`.
        self._can_turn_back = True

    def observe(
        self, tracks: Sequence[Track], ego: VehicleState, traffic: values.Traffic, /
    ) -> values.Traffic:
        """Return the traffic with the gap next to the truck, which may have another lead."""
        gap = self._ramp.finder.find_beside(tracks, ego)
        lead = traffic.lead if gap.ahead is None else find_nearer(gap.ahead, traffic.lead)
        self._left_m = self._path.left_m(ego.x_m)
        self._can_turn_back = self._ramp.can_turn_back(ego)
        return values.Traffic(lead, traffic.neighbour, self._ramp.find_end(ego), {self._name: gap})

    def propose(self, start: values.PlanStart, traffic: values.Traffic, /) -> list[values.Profile]:
        """Return the rest of the change, and while the truck can turn back, its abortion."""
        gap = traffic.gaps[self._name]
        going_on = self._ramp.planner.continue_change(self._name, gap, start, self._left_m)
        return [going_on, self._make_abort(start, traffic)] if self._can_turn_back else [going_on]

    def _make_abort(self, start: values.PlanStart, traffic: values.Traffic) -> values.Profile:
        settings = self._ramp.candidates
        # Back in the lane, its end comes nearer: the harder of the two counts.
        gentle, firm = hold(start, traffic, settings), stop(start, traffic, settings) or 0.0
        return roll_out(ABORT, start, min(gentle, firm), self._ramp.limits)

    def decide(
        self,
        choice: values.RuleChoice,
        _offered: Sequence[values.Profile],
        ego: VehicleState,
        /,
    ) -> tuple[values.RuleChoice, LanePlanner]:
        """Go on to the end of the change, or turn back."""
        ramp = self._ramp
        if choice.profile.name == ABORT:
            return choice, ApproachingGap(ramp, ramp.make_path(ego, 0.0))
        if self._left_m > 0.0:
            return choice, self
        return choice, ramp.make_in_lane()


def make_lane_planner(
    settings: MergeSettings, mission: Mission, candidates: CandidateSettings, limits: TruckLimits
) -> LanePlanner:
    """Return the first phase: approaching a gap if lane 0 ends, else staying in the lane."""
    ends_x_m = mission.lane_0_ends_x_m
    if ends_x_m is None:
        return InLane(mission, candidates, limits)
    return ApproachingGap(
        EndingLane(ends_x_m, settings, mission, candidates, limits), make_straight_path(0.0)
    )
