"""What the planner decided in one step, and why."""

import msgspec

from eigenfail.values import Account
from eigenfail_workers.planners.rulebook.driving_modes import DrivingMode
from eigenfail_workers.planners.rulebook.lanes import Phase
from eigenfail_workers.planners.rulebook.overrides import Override
from eigenfail_workers.planners.rulebook.quadratic_program import QpStatus
from eigenfail_workers.planners.rulebook.surroundings import Gap, Surroundings


class Decision(msgspec.Struct, frozen=True):
    """One step, explained.

    Attributes:
        candidate: name of the chosen one.
        rule: that turned its last rival down.
        planned_mps2: what the candidate asked for.
        acceleration_mps2: what the truck was told.
        speed_mps: of the truck when it decided.
        phase: what follows across the road.
        tracks: state of every track.
        lost_tracks: trusted tracks given up since the start of the episode.
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
    phase: Phase
    around: Surroundings
    tracks: tuple[str, ...]
    lost_tracks: int

    def account(self) -> Account:
        """The step in plain names and values; see `ExplainingPlanner`."""
        return {
            "mode": str(self.mode),
            "candidate": self.candidate,
            "rule": self.rule,
            "override": str(self.override),
            "qp_status": str(self.qp_status),
            "planned_mps2": self.planned_mps2,
            **self._heeded(),
            **self._across(),
            "tracks": " ".join(self.tracks),
            "lost_tracks": self.lost_tracks,
        }

    def _heeded(self) -> Account:
        """The lead; if there is none, the slower neighbour that may become it."""
        for name, other in (("lead", self.around.lead), ("neighbour", self.around.neighbour)):
            if other is not None:
                closing_mps = self.speed_mps - other.speed_mps
                return {"heeds": name, "gap_m": other.gap_m, "closing_mps": closing_mps}
        return {"heeds": "nobody"}

    def _across(self) -> Account:
        """Where the lane ends: how far that is, and the gap that the truck makes for."""
        around = self.around
        if around.lane_end is None:
            return {}
        told: Account = {"phase": str(self.phase), "lane_end_m": around.lane_end.gap_m}
        gap = around.gaps.get(self.candidate, Gap())
        for name, other in (("ahead_m", gap.ahead), ("behind_m", gap.behind)):
            if other is not None:
                told[name] = other.gap_m
        return told
