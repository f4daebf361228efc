"""The planner: track, judge, propose, choose, refine, override, steer."""

from typing import Annotated

import msgspec
from msgspec import Meta

from eigenfail.values import Account, Control, Mission, Path, Perception, VehicleState
from eigenfail_workers.planners.rulebook.brake_lights import (
    BrakeLightSettings,
    WatchfulTracker,
)
from eigenfail_workers.planners.rulebook.candidates import CandidateSettings, Profile, Start
from eigenfail_workers.planners.rulebook.decision import Decision
from eigenfail_workers.planners.rulebook.driving_modes import ModeMachine, ModeSettings
from eigenfail_workers.planners.rulebook.intent import IntentSettings, judge
from eigenfail_workers.planners.rulebook.lanes import LanePlanner
from eigenfail_workers.planners.rulebook.merging import lane_planner
from eigenfail_workers.planners.rulebook.overrides import (
    EmergencyBrake,
    Override,
    OverrideSettings,
    fall_back,
)
from eigenfail_workers.planners.rulebook.ramp import MergeSettings
from eigenfail_workers.planners.rulebook.refine import Refiner, RefineSettings
from eigenfail_workers.planners.rulebook.rules import Question, RuleSettings, Verdict, choose
from eigenfail_workers.planners.rulebook.surroundings import Surroundings, look_around
from eigenfail_workers.planners.rulebook.tracker import TrackerSettings
from eigenfail_workers.planners.rulebook.truck import TruckLimits, towards


class RulebookSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Settings of all parts.

    Attributes:
        beside_m: neighbours farther to the side than this are none.
    """

    tracker: TrackerSettings = TrackerSettings()
    brake_lights: BrakeLightSettings = BrakeLightSettings()
    intent: IntentSettings = IntentSettings()
    modes: ModeSettings = ModeSettings()
    candidates: CandidateSettings = CandidateSettings()
    rules: RuleSettings = RuleSettings()
    merging: MergeSettings = MergeSettings()
    refine: RefineSettings = RefineSettings()
    overrides: OverrideSettings = OverrideSettings()
    truck: TruckLimits = TruckLimits()
    beside_m: Annotated[float, Meta(gt=0.0, le=20.0)] = 6.0


class Rulebook:
    """A cautious truck driver.

    Attributes:
        last_decision: what was decided in the last step, and why; None before the first.
    """

    Settings = RulebookSettings

    def __init__(self, settings: RulebookSettings) -> None:
        self._settings = settings
        self._refiner = Refiner(settings.refine, settings.truck)

    def reset(self, mission: Mission) -> None:
        """A new episode begins."""
        settings = self._settings
        self._mission = mission
        self._tracker = WatchfulTracker(settings.tracker, settings.brake_lights, mission.dt_s)
        self._modes = ModeMachine(settings.modes, mission)
        self._brake = EmergencyBrake(settings.overrides)
        self._lane = lane_planner(settings.merging, mission, settings.candidates, settings.truck)
        self._refiner.reset()
        self._acceleration_mps2 = 0.0
        self._planned: tuple[VehicleState, Profile] | None = None
        self.last_decision: Decision | None = None

    def act(self, perception: Perception) -> Control:
        """Decide on one step."""
        ego, settings = perception.ego, self._settings
        tracks = self._tracker.update(perception)
        for track in tracks:
            judge(track, ego, self._mission.dt_s, settings.intent)
        around = look_around(tracks, ego, settings.beside_m, self._tracker.braking)
        around = self._lane.look(tracks, ego, around)
        mode, task = self._modes.update(ego)
        start = Start(ego.speed_mps, self._acceleration_mps2, task)
        verdict, self._lane = self._choose(start, around, ego)
        qp_status, refined = self._refiner(verdict.profile, start, around.lead)
        override, wanted = self._override(verdict, refined, around, ego.speed_mps)
        self._command(override, wanted)
        self._planned = (ego, verdict.profile)
        self.last_decision = Decision(
            time_s=perception.time_s,
            mode=mode,
            candidate=verdict.profile.name,
            rule=verdict.rule,
            override=override,
            qp_status=qp_status,
            planned_mps2=verdict.profile.target_mps2,
            acceleration_mps2=self._acceleration_mps2,
            speed_mps=ego.speed_mps,
            phase=self._lane.phase,
            around=around,
            tracks=tuple([track.state for track in tracks]),
            lost_tracks=self._tracker.lost,
        )
        return Control(self._acceleration_mps2, self._lane.steer(ego))

    def explain(self) -> Account:
        """See `ExplainingPlanner`."""
        return {} if self.last_decision is None else self.last_decision.account()

    def path(self) -> Path:
        """See `PlottingPlanner`: the chosen candidate, before refinement and overrides."""
        if self._planned is None:
            return ()
        ego, profile = self._planned
        places = [ego.x_m + way_m for way_m in profile.ways]
        ahead = [(x_m, self._lane.lateral_m(ego, x_m)) for x_m in places]
        return ((ego.x_m, ego.y_m), *ahead)

    def _choose(
        self, start: Start, around: Surroundings, ego: VehicleState
    ) -> tuple[Verdict, LanePlanner]:
        """The chosen candidate, and what follows from it across the road."""
        settings = self._settings
        question = Question(around, start.speed_mps, self._mission.speed_limit_mps, settings.rules)
        offered = self._lane.propose(start, around)
        return self._lane.settle(choose(offered, question), offered, ego)

    def _override(
        self, verdict: Verdict, refined: float | None, around: Surroundings, speed_mps: float
    ) -> tuple[Override, float]:
        """What has the last word, and its acceleration [m/s²]."""
        if self._brake.update(around.lead, speed_mps):
            return Override.EMERGENCY_BRAKE, -self._settings.truck.peak_braking_mps2
        if refined is None:
            return Override.QP_FALLBACK, fall_back(verdict.profile.target_mps2)
        return Override.NONE, refined

    def _command(self, override: Override, wanted: float) -> None:
        """Go to the wanted acceleration as fast as the jerk allows."""
        truck = self._settings.truck
        jerk = (
            truck.emergency_jerk_mps3
            if override is Override.EMERGENCY_BRAKE
            else truck.comfort_jerk_mps3
        )
        change = jerk * self._mission.dt_s
        self._acceleration_mps2 = towards(wanted, self._acceleration_mps2, change)
