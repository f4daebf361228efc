"""Braking lead: the car that the truck follows in its lane brakes hard."""

from typing import Annotated

import msgspec
from msgspec import Meta

from eigenfail.values.scene import Mission, VehicleState
from eigenfail_workers import scenarios

# 15 s: within the bounds of the parameters the car has done with braking after 11.7 s.
STEPS = 150
GOAL_M = 1000.0


class LeadBrakeParameters(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters. The gap is between the truck's front and the car's rear bumper."""

    gap_m: Annotated[
        float, Meta(ge=50.0, le=80.0, description="Gap at the start [m].", extra={"nearby": 5.0})
    ] = 60.0
    speed_mps: Annotated[
        float, Meta(ge=18.0, le=22.0, description="Speed of both at the start [m/s].")
    ] = 20.0
    final_speed_mps: Annotated[
        float, Meta(ge=5.0, le=16.0, description="Speed to which the car brakes [m/s].")
    ] = 8.0
    deceleration_mps2: Annotated[
        float, Meta(ge=3.0, le=4.0, description="Braking of the car [m/s²].")
    ] = 3.5
    brakes_at_s: Annotated[
        float, Meta(ge=2.0, le=6.0, description="When the car begins to brake [s].")
    ] = 4.0


class LeadBrakeSituation(msgspec.Struct, frozen=True):
    """A braking lead with its parameters filled in (contract `Situation`).

    Attributes:
        brakes_at_s: time at which the car begins to brake.
        braking_lasts_s: time that it takes to reach its final speed.
        deceleration_mps2: constant while it brakes.
    """

    mission: Mission
    steps: int
    ego: VehicleState
    actors: tuple[VehicleState, ...]
    brakes_at_s: float
    braking_lasts_s: float
    deceleration_mps2: float

    def move_actor(self, actor: int, step: int, ego: VehicleState) -> VehicleState:  # noqa: ARG002 - the contract's; this script does not react to the ego
        """Return the state of the car after `step` steps."""
        start = self.actors[actor]
        time_s = step * self.mission.dt_s
        braking_s = min(max(time_s - self.brakes_at_s, 0.0), self.braking_lasts_s)
        lost_mps = self.deceleration_mps2 * braking_s
        since_s = max(time_s - self.brakes_at_s - self.braking_lasts_s, 0.0)
        # While it brakes it has lost half of the speed on average, and from then on all of it.
        lost_m = lost_mps * (0.5 * braking_s + since_s)
        return msgspec.structs.replace(
            start,
            x_m=start.x_m + start.speed_mps * time_s - lost_m,
            speed_mps=start.speed_mps - lost_mps,
        )


class LeadBrake:
    """The scenario: two lanes, the truck behind a car on the right one."""

    Parameters = LeadBrakeParameters

    def __call__(self, parameters: LeadBrakeParameters, seed: int) -> LeadBrakeSituation:  # noqa: ARG002 - the contract's; nothing is random here
        """Return the situation for some parameters; nothing in it is random."""
        lead_x_m = parameters.gap_m + (scenarios.TRUCK_LENGTH_M + scenarios.CAR_LENGTH_M) / 2.0
        lost_mps = parameters.speed_mps - parameters.final_speed_mps
        return LeadBrakeSituation(
            mission=scenarios.make_mission(parameters.speed_mps, GOAL_M),
            steps=STEPS,
            ego=scenarios.make_truck(parameters.speed_mps),
            actors=(scenarios.make_car(lead_x_m, 0, parameters.speed_mps),),
            brakes_at_s=parameters.brakes_at_s,
            braking_lasts_s=lost_mps / parameters.deceleration_mps2,
            deceleration_mps2=parameters.deceleration_mps2,
        )
