"""Settings of the planner `rulebook`, part by part, with their bounds and defaults."""

from typing import Annotated

import msgspec
from msgspec import Meta

Positive = Annotated[float, Meta(gt=0.0, le=100.0)]
Count = Annotated[int, Meta(ge=1, le=100)]
Offset = Annotated[float, Meta(gt=0.0, le=10.0)]
Speed = Annotated[float, Meta(gt=0.0, le=40.0)]
Acceleration = Annotated[float, Meta(gt=0.0, le=5.0)]
Braking = Annotated[float, Meta(gt=0.0, le=7.0)]
Metres = Annotated[float, Meta(ge=0.0, le=100.0)]
Seconds = Annotated[float, Meta(ge=0.0, le=5.0)]


class TruckLimits(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Limits of the truck's acceleration and jerk.

    Attributes:
        peak_braking_mps2: deceleration of an emergency stop.
        comfort_braking_mps2: largest planned deceleration.
        comfort_jerk_mps3: largest planned jerk.
        emergency_jerk_mps3: largest jerk in an emergency.
    """

    peak_braking_mps2: Annotated[float, Meta(gt=0.0, le=10.0)] = 7.0
    comfort_braking_mps2: Annotated[float, Meta(gt=0.0, le=7.0)] = 4.0
    comfort_jerk_mps3: Annotated[float, Meta(gt=0.0, le=20.0)] = 4.0
    emergency_jerk_mps3: Annotated[float, Meta(gt=0.0, le=50.0)] = 15.0


class TrackerSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How perceived positions become tracks.

    Attributes:
        range_slope: the sensor's specification sigma_x = range_slope · |dx| + range_base_m.
        range_base_m: constant term of sigma_x.
        lateral_slope: the sensor's specification sigma_y = lateral_slope · |dy| + lateral_base_m.
        lateral_base_m: constant term of sigma_y.
        range_acceleration_mps2: standard deviation of a vehicle's acceleration along the road.
        lateral_acceleration_mps2: standard deviation of its acceleration across the road.
        gate: largest accepted sum of both squared innovations over their variances; chi-square
            with two degrees of freedom, 9.21 for 99 %.
        misses_to_delete: rejected measurements in a row that end a confirmed track.
        hits_to_confirm: accepted measurements that confirm a tentative track.
        tentative_misses: rejected measurements that end a tentative track.
        first_speed_sd_mps: standard deviation of the speed of a new track, around the truck's own.
        again_speed_sd_mps: the same for a vehicle that reappears after its track was deleted.
        lateral_speed_sd_mps: standard deviation of the lateral speed of a new track, around 0.
    """

    # The paper's sigma: under the default disturbance model the filters know their noise exactly.
    range_slope: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.02
    range_base_m: Positive = 1.0
    lateral_slope: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.00625
    lateral_base_m: Positive = 0.2
    range_acceleration_mps2: Positive = 0.3
    lateral_acceleration_mps2: Positive = 0.15
    gate: Positive = 9.21
    misses_to_delete: Count = 8
    hits_to_confirm: Count = 5
    tentative_misses: Count = 2
    # A vehicle that is seen for the first time may have any speed. One that is seen again is taken
    # to drive like the truck, with far too little doubt: this is the planner's known flaw
    # (`tracker`).
    first_speed_sd_mps: Positive = 8.0
    again_speed_sd_mps: Positive = 1.75
    lateral_speed_sd_mps: Positive = 1.0


class BrakeLightSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """When brake lights are on, and how they affect a track.

    Attributes:
        lit_from_mps2: deceleration from which a vehicle's brake lights are on.
        acceleration_mps2: standard deviation of its acceleration while they are on.
    """

    lit_from_mps2: Annotated[float, Meta(gt=0.0, le=10.0)] = 1.0
    acceleration_mps2: Annotated[float, Meta(ge=0.0, le=10.0)] = 5.0


class IntentSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How the intent to enter the truck's lane is recognised.

    Attributes:
        preview_s: how far ahead the lateral position is predicted.
        enter_m: a vehicle nearer than this to the truck's line gains evidence.
        leave_m: a vehicle farther than this loses evidence.
        commit: evidence at which a vehicle becomes the lead; it remains so until none is left.
        youngest_s: least age of a track of which the intent is recognised.
    """

    preview_s: Annotated[float, Meta(ge=0.0, le=5.0)] = 1.0
    enter_m: Offset = 2.4
    leave_m: Offset = 2.8
    commit: Annotated[int, Meta(ge=1, le=100)] = 5
    youngest_s: Annotated[float, Meta(ge=0.0, le=10.0)] = 1.5


class ModeSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Speeds and accelerations of the modes.

    Attributes:
        departed_mps: speed at which the departure ends.
        departure_acceleration_mps2: acceleration of a loaded truck from rest.
        highway_acceleration_mps2: acceleration that its power leaves at high speed.
        arrival_deceleration_mps2: deceleration to rest at the goal.
        arrival_margin_m: distance by which braking begins earlier.
        arrival_lead_s: lag of the speed behind its target, which the arrival compensates.
    """

    departed_mps: Speed = 15.0
    departure_acceleration_mps2: Acceleration = 0.8
    highway_acceleration_mps2: Acceleration = 0.5
    arrival_deceleration_mps2: Acceleration = 1.0
    arrival_margin_m: Annotated[float, Meta(ge=0.0, le=500.0)] = 30.0
    arrival_lead_s: Annotated[float, Meta(ge=0.0, le=10.0)] = 2.5


class CandidateSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How candidates are shaped.

    Attributes:
        lead_margin_m: least gap to a lead.
        lead_headway_s: time headway at which a lead is followed.
        headway_gain_per_s2: gain at which a missing headway is restored.
        neighbour_margin_m: least gap to a slower neighbour, which may change into the lane.
        neighbour_braking_mps2: largest deceleration behind a neighbour.
        speed_gain_per_s: gain at which the target speed is approached.
        turning_room_m: distance to the end of the lane at which the truck stops.
    """

    lead_margin_m: Annotated[float, Meta(ge=0.0, le=30.0)] = 5.0
    lead_headway_s: Annotated[float, Meta(ge=0.0, le=5.0)] = 1.0
    headway_gain_per_s2: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.04
    neighbour_margin_m: Annotated[float, Meta(ge=0.0, le=50.0)] = 10.0
    neighbour_braking_mps2: Annotated[float, Meta(gt=0.0, le=7.0)] = 1.5
    speed_gain_per_s: Annotated[float, Meta(gt=0.0, le=5.0)] = 0.4
    turning_room_m: Annotated[float, Meta(ge=0.0, le=200.0)] = 60.0


class RuleSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Thresholds of the rules.

    Attributes:
        lead_margin_m: required gap to a lead.
        lead_need_mps2: required deceleration behind a lead below which the truck need not react.
        neighbour_margin_m: required gap to a slower neighbour.
        neighbour_need_mps2: required deceleration behind a slower neighbour from which the truck
            drops back before the neighbour merges: the defensive rule.
        turning_room_m: distance to the end of the lane that a truck needs to leave it.
        lane_end_need_mps2: required deceleration before the end of the lane at which it brakes.
        comfort_mps2: acceleration beyond which a candidate is uncomfortable.
    """

    lead_margin_m: Annotated[float, Meta(ge=0.0, le=30.0)] = 5.0
    lead_need_mps2: Annotated[float, Meta(ge=0.0, le=5.0)] = 0.2
    neighbour_margin_m: Annotated[float, Meta(ge=0.0, le=50.0)] = 10.0
    neighbour_need_mps2: Annotated[float, Meta(ge=0.0, le=5.0)] = 1.0
    turning_room_m: Annotated[float, Meta(ge=0.0, le=200.0)] = 60.0
    lane_end_need_mps2: Annotated[float, Meta(ge=0.0, le=5.0)] = 2.2
    comfort_mps2: Annotated[float, Meta(gt=0.0, le=7.0)] = 2.5


class GapSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Which gaps are considered.

    Attributes:
        youngest_s: least age of the tracks that bound a gap.
        clear_behind_m: a vehicle farther behind than this does not bound a gap.
    """

    youngest_s: Annotated[float, Meta(ge=0.0, le=10.0)] = 1.5
    clear_behind_m: Annotated[float, Meta(ge=0.0, le=500.0)] = 80.0


class LateralSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How the truck changes lanes.

    Attributes:
        change_s: duration of a change at its initial speed.
        shortest_m: least length of a change, however slow the truck is.
    """

    change_s: Annotated[float, Meta(gt=0.0, le=20.0)] = 5.0
    shortest_m: Annotated[float, Meta(ge=35.0, le=200.0)] = 50.0


class RequiredGap(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Required gap between two vehicles, one behind the other."""

    margin_m: Metres
    headway_s: Seconds
    braking_mps2: Braking

    def gap_m(self, rear_mps: float, front_mps: float) -> float:
        """Required gap at two speeds. [m]"""
        closing = max(rear_mps - front_mps, 0.0)
        return self.margin_m + self.headway_s * rear_mps + closing**2 / (2.0 * self.braking_mps2)


class ChangeSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """When a gap fits, and how the truck approaches it.

    Attributes:
        ahead: required gap to the vehicle ahead.
        behind: required gap to the vehicle behind, with little braking: it need not make room.
        begun_share: share of the required gaps that must remain after the change has begun.
        spare_m: distance that the approach adds to the required gap.
        gap_gain_per_s2: gain at which a missing distance is made up.
        speed_gain_per_s: gain at which the speed of the vehicle ahead is approached.
        braking_mps2: largest deceleration of the approach.
    """

    ahead: RequiredGap = RequiredGap(margin_m=5.0, headway_s=0.6, braking_mps2=1.5)
    behind: RequiredGap = RequiredGap(margin_m=4.0, headway_s=0.4, braking_mps2=0.5)
    begun_share: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.5
    spare_m: Metres = 3.0
    gap_gain_per_s2: Annotated[float, Meta(ge=0.0, le=1.0)] = 0.09
    speed_gain_per_s: Annotated[float, Meta(ge=0.0, le=5.0)] = 0.6
    braking_mps2: Braking = 2.0
    lateral: LateralSettings = LateralSettings()


class MergeSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """How the truck leaves a lane that ends.

    Attributes:
        commit: number of steps in a row in which a gap must fit before the change begins, and in
            which another candidate must win by progress alone before the truck prefers it.
    """

    gaps: GapSettings = GapSettings()
    changes: ChangeSettings = ChangeSettings()
    commit: Annotated[int, Meta(ge=1, le=100)] = 5


class SolverSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Settings of OSQP; see its documentation.

    Attributes:
        max_iterations: the only bound, as wall time would make answers irreproducible.
        check_every: iterations between two tests for convergence.
        tolerance: absolute and relative.
        rho: step size of the method, fixed.
    """

    max_iterations: Annotated[int, Meta(ge=1, le=100_000)] = 1000
    check_every: Annotated[int, Meta(ge=1, le=1000)] = 5
    tolerance: Annotated[float, Meta(gt=0.0, le=0.1)] = 1e-4
    rho: Annotated[float, Meta(gt=0.0, le=1e6)] = 0.1


class RefineSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Horizon and weights of the program.

    Attributes:
        horizon_s: horizon of the program; beyond the candidate's own, its last acceleration goes
            on.
        knots: number of knots in the horizon.
        jerk_weight: weight of the squared jerk against the squared departure from the
            candidate [s²].
        slack_weight: cost of a squared metre of missing gap to the lead.
        slack_price: cost of a metre of missing gap to the lead.
        margin_m: gap to the lead over the horizon.
    """

    horizon_s: Annotated[float, Meta(ge=1.0, le=20.0)] = 5.0
    knots: Annotated[int, Meta(ge=2, le=200)] = 20
    jerk_weight: Annotated[float, Meta(ge=0.0, le=1e3)] = 0.075
    slack_weight: Annotated[float, Meta(gt=0.0, le=1e3)] = 0.05
    slack_price: Annotated[float, Meta(ge=0.0, le=1e3)] = 0.25
    margin_m: Annotated[float, Meta(ge=0.0, le=30.0)] = 4.0
    solver: SolverSettings = SolverSettings()

    @property
    def knot_s(self) -> float:
        """Duration of a knot. [s]"""
        return self.horizon_s / self.knots


class OverrideSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Thresholds of the emergency brake, which overrides rules and quadratic program.

    Attributes:
        margin_m: gap that the emergency brake keeps.
        brake_at_mps2: required deceleration that triggers it.
        release_at_mps2: required deceleration at which it is released.
        brake_at_s: time to collision that triggers it at any deceleration.
    """

    margin_m: Annotated[float, Meta(ge=0.0, le=20.0)] = 3.0
    brake_at_mps2: Annotated[float, Meta(gt=0.0, le=10.0)] = 3.5
    release_at_mps2: Annotated[float, Meta(gt=0.0, le=10.0)] = 2.0
    brake_at_s: Annotated[float, Meta(ge=0.0, le=5.0)] = 0.8


class RulebookSettings(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Settings of all parts.

    Attributes:
        beside_m: lateral distance beyond which a vehicle is not a neighbour.
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
