"""The planner `rulebook`: track, recognise intent, propose, choose, refine, override, steer."""

from typing import ClassVar

from eigenfail.values.proof import Account, Path
from eigenfail.values.scene import Control, Mission, Perception, VehicleState
from eigenfail_workers.planners.rulebook import values
from eigenfail_workers.planners.rulebook.candidates import limit_change
from eigenfail_workers.planners.rulebook.driving_modes import ModeMachine
from eigenfail_workers.planners.rulebook.lanes import LanePlanner, make_lane_planner
from eigenfail_workers.planners.rulebook.refine import Refiner
from eigenfail_workers.planners.rulebook.rules import choose
from eigenfail_workers.planners.rulebook.settings import OverrideSettings, RulebookSettings
from eigenfail_workers.planners.rulebook.tracker import BrakeLightTracker, update_intent
from eigenfail_workers.planners.rulebook.traffic import find_traffic, required_deceleration


class EmergencyBrake:
    """Full braking with hysteresis between two thresholds."""

    def __init__(self, settings: OverrideSettings) -> None:
        self._settings = settings
        self._braking = False

    def update(self, lead: values.Neighbour | None, speed_mps: float) -> bool:
        """Return whether to brake now."""
        if lead is None:
            self._braking = False
            return False
        closing_mps = speed_mps - lead.speed_mps
        need = required_deceleration(lead.gap_m, closing_mps, self._settings.margin_m)
        # Two thresholds: with one, the brake would open and close in turn around it.
        bar = self._settings.release_at_mps2 if self._braking else self._settings.brake_at_mps2
        self._braking = need > bar or lead.gap_m < closing_mps * self._settings.brake_at_s
        return self._braking


def fall_back(planned_mps2: float) -> float:
    """Return the candidate's braking, without acceleration, for want of a refined plan. [m/s²]"""
    return min(planned_mps2, 0.0)


class Rulebook:
    """A cautious truck driver.

    Attributes:
        last_decision: decision of the last step; None before the first.
        signal_names: names of its signals; see `SignallingPlanner`.
    """

    Settings: ClassVar = RulebookSettings
    signal_names: ClassVar = ("lost_tracks", "planned_mps2")

    def __init__(self, settings: RulebookSettings) -> None:
        self._settings = settings
        self._refiner = Refiner(settings.refine, settings.truck)

    def reset(self, mission: Mission) -> None:
        """Begin a new episode."""
        settings = self._settings
        self._mission = mission
        self._tracker = BrakeLightTracker(settings.tracker, settings.brake_lights, mission.dt_s)
        self._modes = ModeMachine(settings.modes, mission)
        self._brake = EmergencyBrake(settings.overrides)
        self._lane = make_lane_planner(
            settings.merging, mission, settings.candidates, settings.truck
        )
        self._refiner.reset()
        self._acceleration_mps2 = 0.0
        self._planned: tuple[VehicleState, values.Profile] | None = None
        self.last_decision: values.Decision | None = None

    def act(self, perception: Perception) -> Control:
        """Return the control of one step."""
        ego, settings = perception.ego, self._settings
        tracks = self._tracker.update(perception)
        for track in tracks:
            update_intent(track, ego, self._mission.dt_s, settings.intent)
        # Before the lane adds to it: gaps are of the next lane, the lead of the truck's own.
        traffic = find_traffic(tracks, ego, settings.beside_m, self._tracker.braking)
        traffic = self._lane.observe(tracks, ego, traffic)
        mode, task = self._modes.update(ego)
        start = values.PlanStart(ego.speed_mps, self._acceleration_mps2, task)
        choice, self._lane = self._choose(start, traffic, ego)
        qp_status, refined = self._refiner(choice.profile, start, traffic.lead)
        override, wanted = self._override(choice, refined, traffic, ego.speed_mps)
        self._command(override, wanted)
        self._planned = (ego, choice.profile)
        self.last_decision = values.Decision(
            time_s=perception.time_s,
            mode=mode,
            candidate=choice.profile.name,
            rule=choice.rule,
            override=override,
            qp_status=qp_status,
            planned_mps2=choice.profile.target_mps2,
            acceleration_mps2=self._acceleration_mps2,
            speed_mps=ego.speed_mps,
            phase=self._lane.phase,
            traffic=traffic,
            tracks=tuple([track.state for track in tracks]),
            lost_tracks=self._tracker.lost,
            lost_vehicles=tuple(self._tracker.lost_now),
        )
        return Control(self._acceleration_mps2, self._lane.steer(ego))

    def explain(self) -> Account:
        """Return the last decision; see `ExplainingPlanner`."""
        return {} if self.last_decision is None else self.last_decision.account()

    def signals(self) -> dict[str, float]:
        """Return the number of lost tracks so far, and the planned acceleration [m/s²]."""
        decision = self.last_decision
        if decision is None:
            return {"lost_tracks": 0.0, "planned_mps2": 0.0}
        return {
            "lost_tracks": float(decision.lost_tracks),
            "planned_mps2": decision.planned_mps2,
        }

    def count_losses(self, vehicle: int) -> int:
        """Return the losses of a vehicle's tracks; see `TrackingPlanner`."""
        return self._tracker.losses.get(vehicle, 0)

    def path(self) -> Path:
        """Return the path of the chosen candidate; see `PlottingPlanner`."""
        if self._planned is None:
            return ()
        ego, profile = self._planned
        places = [ego.x_m + way_m for way_m in profile.ways]
        return ((ego.x_m, ego.y_m), *((x_m, self._lane.lateral_m(ego, x_m)) for x_m in places))

    def _choose(
        self, start: values.PlanStart, traffic: values.Traffic, ego: VehicleState
    ) -> tuple[values.RuleChoice, LanePlanner]:
        """Return the chosen candidate, and the next phase of the lateral task."""
        limit_mps = self._mission.speed_limit_mps
        context = values.RuleContext(traffic, start.speed_mps, limit_mps, self._settings.rules)
        offered = self._lane.propose(start, traffic)
        return self._lane.decide(choose(offered, context), offered, ego)

    def _override(
        self,
        choice: values.RuleChoice,
        refined: float | None,
        traffic: values.Traffic,
        speed_mps: float,
    ) -> tuple[values.Override, float]:
        """Return the override, and the wanted acceleration. [m/s²]"""
        # Asked first, and in every step, as it remembers whether it brakes.
        if self._brake.update(traffic.lead, speed_mps):
            return values.Override.EMERGENCY_BRAKE, -self._settings.truck.peak_braking_mps2
        if refined is None:
            return values.Override.QP_FALLBACK, fall_back(choice.profile.target_mps2)
        return values.Override.NONE, refined

    def _command(self, override: values.Override, wanted: float) -> None:
        """Set the commanded acceleration to the wanted one, as far as the jerk limit allows."""
        truck = self._settings.truck
        jerk = (
            truck.emergency_jerk_mps3
            if override is values.Override.EMERGENCY_BRAKE
            else truck.comfort_jerk_mps3
        )
        change = jerk * self._mission.dt_s
        self._acceleration_mps2 = limit_change(wanted, self._acceleration_mps2, change)
