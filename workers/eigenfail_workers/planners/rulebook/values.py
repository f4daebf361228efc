"""Values that the parts of the planner `rulebook` exchange."""

from collections.abc import Mapping
from enum import StrEnum
from math import inf

import msgspec
import numpy as np
from numpy.typing import NDArray

from eigenfail.values.proof import Account
from eigenfail_workers.motion import minimum_jerk
from eigenfail_workers.planners.rulebook.settings import RuleSettings


class Neighbour(msgspec.Struct, frozen=True, gc=False):
    """A trusted vehicle ahead, relative to the truck.

    Attributes:
        gap_m: gap from the truck's front bumper to the rear bumper of the vehicle.
        aside_m: distance between the two centre lines.
        speed_mps: along the road.
        is_braking: whether its brake lights are on.
        number: the sensor's number of the vehicle; 0 if the neighbour is not a vehicle.
    """

    gap_m: float
    aside_m: float
    speed_mps: float
    is_braking: bool = False
    number: int = 0


class Gap(msgspec.Struct, frozen=True, gc=False):
    """Gap between two vehicles of the next lane; None if no vehicle bounds it.

    Attributes:
        ahead: relative to the truck's front bumper; negative for a vehicle alongside the truck.
        behind: relative to the truck's rear bumper.
    """

    ahead: Neighbour | None = None
    behind: Neighbour | None = None


class Traffic(msgspec.Struct, frozen=True):
    """The traffic that the truck must take into account.

    Attributes:
        lead: the nearest vehicle in the truck's lane, or with the intent to enter it.
        neighbour: the nearest vehicle ahead next to the truck's lane, other than the lead.
        lane_end: the end of the truck's lane, as a standing vehicle.
        gaps: gaps of the next lane, by the name of the candidate that uses them.
    """

    lead: Neighbour | None = None
    neighbour: Neighbour | None = None
    lane_end: Neighbour | None = None
    gaps: Mapping[str, Gap] = {}


class DrivingMode(StrEnum):
    """Mode of driving."""

    DEPARTURE = "departure"
    HIGHWAY = "highway"
    ARRIVAL = "arrival"


class Task(msgspec.Struct, frozen=True, gc=False):
    """Target speed of a mode, and the largest acceleration towards it."""

    target_mps: float
    max_acceleration_mps2: float


class PlanStart(msgspec.Struct, frozen=True, gc=False):
    """State of the truck when it decides: speed, present acceleration, and task."""

    speed_mps: float
    acceleration_mps2: float
    task: Task


class LaneChange(msgspec.Struct, frozen=True):
    """Lateral part of a candidate: a change into a gap of the next lane.

    Attributes:
        begins: knot at which the change begins, 0 for now; None if the gap fits at no knot.
        short_ahead_m: length that the gap lacks ahead of the truck: the largest one after the
            begin; without a begin, the length at the last knot.
        short_behind_m: length that the gap lacks behind the truck, likewise.
        over_m: way to the end of the change.
        hit_mps: speed at which the vehicle behind would run into the truck.
    """

    begins: int | None = None
    short_ahead_m: float = 0.0
    short_behind_m: float = 0.0
    over_m: float = inf
    hit_mps: float = 0.0


class Profile(msgspec.Struct, frozen=True):
    """A candidate, rolled out over the horizon.

    Attributes:
        name: name of the candidate.
        target_mps2: acceleration that it approaches.
        accelerations: over each of the knots [m/s²].
        ways: distance covered at the end of each knot [m].
        speeds: speed at the end of each knot [m/s].
        change: lateral part; None for a candidate that stays in its lane.
    """

    name: str
    target_mps2: float
    accelerations: list[float]
    ways: list[float]
    speeds: list[float]
    change: LaneChange | None = None


class RuleChoice(msgspec.Struct, frozen=True):
    """The chosen candidate, and the rule that rejected its last rival."""

    profile: Profile
    rule: str


class RuleContext(msgspec.Struct, frozen=True):
    """The context that the rules take into account."""

    traffic: Traffic
    speed_mps: float
    speed_limit_mps: float
    settings: RuleSettings


class LateralPath(msgspec.Struct, frozen=True, gc=False):
    """A path across the road; the lateral position is constant before and after it.

    It is a function of distance, not of time: a truck that brakes on it must not slide sideways.

    Attributes:
        from_m: lateral position before the path.
        to_m: lateral position after it.
        begins_x_m: position along the road at which it begins.
        length_m: along the road.
    """

    from_m: float
    to_m: float
    begins_x_m: float
    length_m: float

    def at(self, x_m: float) -> float:
        """Return the lateral position at a position along the road. [m]"""
        share = min(max((x_m - self.begins_x_m) / self.length_m, 0.0), 1.0)
        return self.from_m + (self.to_m - self.from_m) * minimum_jerk(share)[0]

    def left_m(self, x_m: float) -> float:
        """Return the distance to the end of the path, negative beyond it. [m]"""
        return self.begins_x_m + self.length_m - x_m


class LanePhase(StrEnum):
    """Phase of the lateral task."""

    IN_LANE = "in_lane"
    APPROACHING = "approaching"
    CHANGING = "changing"


class QpStatus(StrEnum):
    """Status of a solution. Only `solved` comes with an answer."""

    SOLVED = "solved"
    ITERATION_LIMIT = "iteration_limit"
    INFEASIBLE = "infeasible"
    NOT_FINITE = "not_finite"
    OTHER = "other"


class Solution(msgspec.Struct, frozen=True, eq=False):
    """An answer of shape (variables,), or None and the status that explains it."""

    status: QpStatus
    x: NDArray[np.float64] | None = None


class Override(StrEnum):
    """Override of the plan."""

    NONE = "none"
    EMERGENCY_BRAKE = "emergency_brake"
    QP_FALLBACK = "qp_fallback"


class Decision(msgspec.Struct, frozen=True):
    """The decision of one step, with its reasons.

    Attributes:
        candidate: name of the chosen one.
        rule: rule that rejected its last rival.
        planned_mps2: acceleration of the candidate.
        acceleration_mps2: commanded acceleration.
        speed_mps: speed of the truck.
        phase: phase of the lateral task from now on.
        tracks: state of every track.
        lost_tracks: number of trusted tracks deleted since the start of the episode.
        lost_vehicles: numbers of the vehicles whose trusted tracks were deleted in this step.
    """

    time_s: float
    mode: DrivingMode
    candidate: str
    rule: str
    override: Override
    qp_status: QpStatus
    planned_mps2: float
    acceleration_mps2: float
    speed_mps: float
    phase: LanePhase
    traffic: Traffic
    tracks: tuple[str, ...]
    lost_tracks: int
    lost_vehicles: tuple[int, ...] = ()

    def account(self) -> Account:
        """Return the decision as plain names and values; see `ExplainingPlanner`."""
        return {
            "mode": str(self.mode),
            "candidate": self.candidate,
            "rule": self.rule,
            "override": str(self.override),
            "qp_status": str(self.qp_status),
            "planned_mps2": self.planned_mps2,
            **self._describe_lead(),
            **self._describe_lane_end(),
            "tracks": " ".join(self.tracks),
            "lost_tracks": self.lost_tracks,
            "lost_vehicles": " ".join(map(str, self.lost_vehicles)),
        }

    def _describe_lead(self) -> Account:
        """Return the lead, or else the slower neighbour that may become it."""
        for name, other in (("lead", self.traffic.lead), ("neighbour", self.traffic.neighbour)):
            if other is not None:
                closing_mps = self.speed_mps - other.speed_mps
                return {
                    "heeds": name,
                    "vehicle": other.number,
                    "gap_m": other.gap_m,
                    "closing_mps": closing_mps,
                }
        return {"heeds": "nobody"}

    def _describe_lane_end(self) -> Account:
        """Return the distance to the end of the lane, and the gap that the truck approaches."""
        traffic = self.traffic
        if traffic.lane_end is None:
            return {}
        account: Account = {"phase": str(self.phase), "lane_end_m": traffic.lane_end.gap_m}
        gap = traffic.gaps.get(self.candidate, Gap())
        for name, other in (("ahead_m", gap.ahead), ("behind_m", gap.behind)):
            if other is not None:
                account[name] = other.gap_m
        return account
