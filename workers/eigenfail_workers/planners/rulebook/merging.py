"""Out of a lane that ends: approach a gap, change into it, or turn back in time."""

from collections.abc import Sequence

from eigenfail.values import Mission, VehicleState
from eigenfail_workers.planners.rulebook.candidates import (
    CandidateSettings,
    Profile,
    Start,
    hold,
    profiles,
    roll_out,
    stop,
)
from eigenfail_workers.planners.rulebook.lanes import LaneHeld, LanePlanner, Phase
from eigenfail_workers.planners.rulebook.lateral import LateralPath, straight_on
from eigenfail_workers.planners.rulebook.ramp import MergeSettings, Ramp
from eigenfail_workers.planners.rulebook.rules import Verdict, progress
from eigenfail_workers.planners.rulebook.surroundings import Surroundings, nearer
from eigenfail_workers.planners.rulebook.tracker import Track
from eigenfail_workers.planners.rulebook.truck import TruckLimits
from eigenfail_workers.planners.steering import look_ahead_m, pursue

ABORT = "abort"
COMMITMENT = "commitment"
"""Stands for the deciding rule where the truck stays with what it chose before."""


class OnPath:
    """What steers along a path across the road."""

    def __init__(self, path: LateralPath) -> None:
        self._path = path

    def steer(self, ego: VehicleState, /) -> float:
        """To where the path is ahead; steering angle [rad]."""
        return pursue(ego, self.lateral_m(ego, ego.x_m + look_ahead_m(ego)))

    def lateral_m(self, _ego: VehicleState, x_m: float, /) -> float:
        """On the path."""
        return self._path.at(x_m)


class Approaching(OnPath):
    """In the lane that ends: makes for a gap. Implements `LanePlanner`.

    Args:
        path: back to the middle of the lane, after a change that was broken off.
    """

    phase = Phase.APPROACHING

    def __init__(self, ramp: Ramp, path: LateralPath) -> None:
        super().__init__(path)
        self._ramp = ramp
        self._name = ""
        self._rival_steps = 0
        self._ready_steps = 0

    def look(
        self, tracks: Sequence[Track], ego: VehicleState, around: Surroundings, /
    ) -> Surroundings:
        """Adds the end of the lane and the gaps of the next one; nothing if it is there already."""
        if self._ramp.is_left(ego):
            return around
        gaps = self._ramp.finder.options(tracks, ego)
        return Surroundings(around.lead, around.neighbour, self._ramp.end(ego), gaps)

    def propose(self, start: Start, around: Surroundings, /) -> list[Profile]:
        """Into each gap, or staying in the lane."""
        planned = self._ramp.planner.planned
        changes = [planned(name, gap, start) for name, gap in around.gaps.items()]
        return changes + profiles(start, around, self._ramp.candidates, self._ramp.limits)

    def settle(
        self,
        verdict: Verdict,
        offered: Sequence[Profile],
        ego: VehicleState,
        /,
    ) -> tuple[Verdict, LanePlanner]:
        """Stay with a choice for a while; begin the change once its gap has fitted long enough."""
        if self._ramp.is_left(ego):
            return verdict, self._ramp.held()
        verdict = self._committed(verdict, offered)
        self._name, change = verdict.profile.name, verdict.profile.change
        fits = change is not None and change.begins == 0
        self._ready_steps = self._ready_steps + 1 if fits else 0
        if self._ready_steps < self._ramp.settings.commit:
            return verdict, self
        return verdict, Changing(self._ramp, self._name, ego)

    def _committed(self, verdict: Verdict, offered: Sequence[Profile]) -> Verdict:
        """The rules' choice, but where it is by progress alone only after some steps in a row."""
        before = [profile for profile in offered if profile.name == self._name]
        is_rival = verdict.rule == progress.__name__ and verdict.profile.name != self._name
        self._rival_steps = self._rival_steps + 1 if before and is_rival else 0
        if 0 < self._rival_steps < self._ramp.settings.commit:
            return Verdict(before[0], COMMITMENT)
        self._rival_steps = 0
        return verdict


class Changing(OnPath):
    """On the way over. Implements `LanePlanner`."""

    phase = Phase.CHANGING

    def __init__(self, ramp: Ramp, name: str, ego: VehicleState) -> None:
        super().__init__(ramp.path(ego, ramp.mission.lane_width_m))
        self._ramp = ramp
        self._name = name
        self._left_m = self._path.length_m
        self._can_turn_back = True

    def look(
        self, tracks: Sequence[Track], ego: VehicleState, around: Surroundings, /
    ) -> Surroundings:
        """Adds what has become of the gap; who is ahead in it is the lead."""
        gap = self._ramp.finder.beside(tracks, ego)
        lead = around.lead if gap.ahead is None else nearer(gap.ahead, around.lead)
        self._left_m = self._path.left_m(ego.x_m)
        self._can_turn_back = self._ramp.can_turn_back(ego)
        return Surroundings(lead, around.neighbour, self._ramp.end(ego), {self._name: gap})

    def propose(self, start: Start, around: Surroundings, /) -> list[Profile]:
        """To go on, and the way back while there is one."""
        gap = around.gaps[self._name]
        going_on = self._ramp.planner.begun(self._name, gap, start, self._left_m)
        return [going_on, self._back(start, around)] if self._can_turn_back else [going_on]

    def _back(self, start: Start, around: Surroundings) -> Profile:
        settings = self._ramp.candidates
        gentle, firm = hold(start, around, settings), stop(start, around, settings) or 0.0
        return roll_out(ABORT, start, min(gentle, firm), self._ramp.limits)

    def settle(
        self,
        verdict: Verdict,
        _offered: Sequence[Profile],
        ego: VehicleState,
        /,
    ) -> tuple[Verdict, LanePlanner]:
        """Go on to the end, or turn back."""
        ramp = self._ramp
        if verdict.profile.name == ABORT:
            return verdict, Approaching(ramp, ramp.path(ego, 0.0))
        if self._left_m > 0.0:
            return verdict, self
        return verdict, ramp.held()


def lane_planner(
    settings: MergeSettings, mission: Mission, candidates: CandidateSettings, limits: TruckLimits
) -> LanePlanner:
    """The first phase, where lane 0 ends and where it does not."""
    ends_x_m = mission.lane_0_ends_x_m
    if ends_x_m is None:
        return LaneHeld(mission, candidates, limits)
    return Approaching(Ramp(ends_x_m, settings, mission, candidates, limits), straight_on(0.0))
