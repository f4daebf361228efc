"""What decides about lanes. A truck is held to its lane as long as that goes on."""

from collections.abc import Sequence
from enum import StrEnum
from typing import Protocol

from eigenfail.values import Mission, VehicleState
from eigenfail_workers.planners.rulebook.candidates import (
    CandidateSettings,
    Profile,
    Start,
    profiles,
)
from eigenfail_workers.planners.rulebook.rules import Verdict
from eigenfail_workers.planners.rulebook.surroundings import Surroundings
from eigenfail_workers.planners.rulebook.tracker import Track
from eigenfail_workers.planners.rulebook.truck import TruckLimits
from eigenfail_workers.planners.steering import LaneKeeping


class Phase(StrEnum):
    """What the truck is about, across the road."""

    IN_LANE = "in_lane"
    APPROACHING = "approaching"
    CHANGING = "changing"


class LanePlanner(Protocol):
    """One phase of the lateral task: in each step look, propose, settle, steer.

    Attributes:
        phase: which.
    """

    phase: Phase

    def look(
        self, tracks: Sequence[Track], ego: VehicleState, around: Surroundings, /
    ) -> Surroundings:
        """What must be heeded because of the lanes, added to what is around."""

    def propose(self, start: Start, around: Surroundings, /) -> list[Profile]:
        """The candidates."""

    def settle(
        self,
        verdict: Verdict,
        offered: Sequence[Profile],
        ego: VehicleState,
        /,
    ) -> tuple[Verdict, "LanePlanner"]:
        """What is done about the rules' verdict, and the phase from then on."""

    def steer(self, ego: VehicleState, /) -> float:
        """The steering angle [rad]."""

    def lateral_m(self, ego: VehicleState, x_m: float, /) -> float:
        """Where across the road the truck means to be once it is there along the road [m]."""


class LaneHeld:
    """Stays in the lane in which it is at first. Implements `LanePlanner`."""

    phase = Phase.IN_LANE

    def __init__(
        self, mission: Mission, candidates: CandidateSettings, limits: TruckLimits
    ) -> None:
        self._candidates = candidates
        self._limits = limits
        self._lane_keeping = LaneKeeping(mission)

    def look(
        self, _tracks: Sequence[Track], _ego: VehicleState, around: Surroundings, /
    ) -> Surroundings:
        """Nothing else: the lane goes on."""
        return around

    def propose(self, start: Start, around: Surroundings, /) -> list[Profile]:
        """Longitudinal ones."""
        return profiles(start, around, self._candidates, self._limits)

    def settle(
        self,
        verdict: Verdict,
        _offered: Sequence[Profile],
        _ego: VehicleState,
        /,
    ) -> tuple[Verdict, LanePlanner]:
        """As the rules say."""
        return verdict, self

    def steer(self, ego: VehicleState, /) -> float:
        """To the centre of the lane."""
        return self._lane_keeping(ego)

    def lateral_m(self, ego: VehicleState, _x_m: float, /) -> float:
        """The centre of the lane."""
        return self._lane_keeping.centre_m(ego)
