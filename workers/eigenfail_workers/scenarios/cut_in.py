"""Cut-in: a slow car moves half-way into the truck's lane ahead of it (paper, fig. 1).

The car stays astride the marking, just in the truck's way.
"""

from math import atan2, ceil, hypot
from typing import Annotated

import msgspec
from msgspec import Meta

from eigenfail.values.scene import Mission, VehicleState
from eigenfail_workers import scenarios
from eigenfail_workers.motion import minimum_jerk

AFTERWARDS_S = 3.0
"""Time for which an episode goes on after the manoeuvre, if it would end before."""

GOAL_M = 1000.0


class CutInParameters(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of the scenario.

    Gaps are between the truck's front and the car's rear bumper.

    Attributes:
        distance_m: gap at which the car begins to cut in, for an ego at constant speed: the car
            follows its script, so that noise cannot change the time.
        final_offset_m: final distance between the centre lines of car and truck. Below 2.25 m their
            footprints overlap laterally.
        peak_braking_mps2: by default the paper's; a loaded truck may brake less.
        dt_s: the frames of the paper are not known. 0.02 s over 14 s make the 700 steps that its
            log p implies.
    """

    distance_m: Annotated[
        float,
        Meta(
            ge=52.0,
            le=70.0,
            description="Gap at which the car begins to come over [m].",
            extra={"nearby": 5.0},
        ),
    ] = 58.0
    initial_gap_m: Annotated[
        float, Meta(ge=80.0, le=140.0, description="Gap at the start [m].")
    ] = 94.0
    ego_speed_mps: Annotated[
        float, Meta(ge=22.0, le=25.0, description="Speed of the truck at the start [m/s].")
    ] = 24.0
    actor_speed_mps: Annotated[
        float, Meta(ge=12.0, le=16.0, description="Speed of the car along the road [m/s].")
    ] = 12.5
    lane_change_s: Annotated[
        float, Meta(ge=2.8, le=3.2, description="Time that the car takes to come over [s].")
    ] = 3.0
    final_offset_m: Annotated[
        float, Meta(ge=1.9, le=2.15, description="The car stays this far from the ego's line [m].")
    ] = 2.1
    dt_s: Annotated[float, Meta(ge=0.02, le=0.1, description="Duration of a step [s].")] = 0.1
    duration_s: Annotated[float, Meta(ge=10.0, le=20.0, description="Least duration [s].")] = 10.0
    peak_braking_mps2: Annotated[float, Meta(ge=3, le=7, description="Peak braking [m/s²].")] = 7.0


class CutInSituation(msgspec.Struct, frozen=True):
    """A cut-in with its parameters filled in (contract `Situation`).

    Attributes:
        change_begins_s: time at which the car leaves the centre of its lane.
        change_lasts_s: duration of the manoeuvre.
        final_offset_m: final distance from the truck's line.
    """

    mission: Mission
    steps: int
    ego: VehicleState
    actors: tuple[VehicleState, ...]
    change_begins_s: float
    change_lasts_s: float
    final_offset_m: float

    def move_actor(self, actor: int, step: int, ego: VehicleState) -> VehicleState:  # noqa: ARG002 - the contract's; this script does not react to the ego
        """Return the state of the car after `step` steps, at constant speed along the road."""
        start = self.actors[actor]
        time_s = step * self.mission.dt_s
        share = (time_s - self.change_begins_s) / self.change_lasts_s
        done, rate = minimum_jerk(min(max(share, 0.0), 1.0))
        way_m = self.final_offset_m - start.y_m
        lateral_mps = way_m * rate / self.change_lasts_s
        return msgspec.structs.replace(
            start,
            x_m=start.x_m + start.speed_mps * time_s,
            y_m=start.y_m + way_m * done,
            heading_rad=atan2(lateral_mps, start.speed_mps),
            speed_mps=hypot(start.speed_mps, lateral_mps),
        )


class CutIn:
    """The scenario: two lanes, the truck on the right one, a slower car on the left one."""

    Parameters = CutInParameters

    def __call__(self, parameters: CutInParameters, seed: int) -> CutInSituation:  # noqa: ARG002 - the contract's; nothing is random here
        """Return the situation for some parameters; nothing in it is random."""
        closing_mps = parameters.ego_speed_mps - parameters.actor_speed_mps
        begins_s = (parameters.initial_gap_m - parameters.distance_m) / closing_mps
        # A short distance at a low closing speed makes a late manoeuvre, which needs more steps.
        over_s = begins_s + parameters.lane_change_s + AFTERWARDS_S
        least = round(parameters.duration_s / parameters.dt_s)
        x_m = parameters.initial_gap_m + (scenarios.TRUCK_LENGTH_M + scenarios.CAR_LENGTH_M) / 2.0
        car = scenarios.make_car(x_m, 1, parameters.actor_speed_mps)
        mission = scenarios.make_mission(parameters.ego_speed_mps, GOAL_M)
        peak = parameters.peak_braking_mps2
        return CutInSituation(
            mission=msgspec.structs.replace(mission, dt_s=parameters.dt_s, peak_braking_mps2=peak),
            steps=max(least, ceil(over_s / parameters.dt_s)),
            ego=scenarios.make_truck(parameters.ego_speed_mps),
            actors=(car,),
            change_begins_s=begins_s,
            change_lasts_s=parameters.lane_change_s,
            final_offset_m=parameters.final_offset_m,
        )
