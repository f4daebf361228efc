"""Merge-in: the truck comes from a ramp and merges between the cars of the main lane."""

from typing import Annotated

import msgspec
from msgspec import Meta

from eigenfail.values.scene import Mission, VehicleState
from eigenfail_workers import scenarios

STEPS = 200
DESIRED_SPEED_MPS = 25.0
GOAL_M = 2000.0
MAIN_LANE = 1


class MergeInParameters(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of the scenario.

    Attributes:
        gap_s: gap from the rear bumper of the first car to the front bumper of the second, in time
            at their speed.
        behind_m: distance from the truck's rear bumper back to the front bumper of the second car;
            negative for a car alongside the truck.
        ramp_m: distance from the truck's front bumper to the end of its lane.
    """

    gap_s: Annotated[
        float, Meta(ge=2.9, le=5.0, description="Time gap between the two cars [s].")
    ] = 3.0
    behind_m: Annotated[
        float, Meta(ge=-25.0, le=40.0, description="Second car behind the truck by this [m].")
    ] = 19.5
    ego_speed_mps: Annotated[
        float, Meta(ge=18.0, le=22.0, description="Speed of the truck at the start [m/s].")
    ] = 20.7
    traffic_speed_mps: Annotated[
        float, Meta(ge=19.0, le=23.0, description="Speed of the cars [m/s].")
    ] = 20.0
    ramp_m: Annotated[
        float, Meta(ge=320.0, le=450.0, description="Length of the ramp's lane that is left [m].")
    ] = 350.0


class MergeInSituation(msgspec.Struct, frozen=True):
    """A merge with its parameters filled in (contract `Situation`)."""

    mission: Mission
    steps: int
    ego: VehicleState
    actors: tuple[VehicleState, ...]

    def move_actor(self, actor: int, step: int, ego: VehicleState) -> VehicleState:  # noqa: ARG002 - the contract's; these cars do not react to the ego
        """Return the state of a car after `step` steps, at constant speed in its lane."""
        start = self.actors[actor]
        return msgspec.structs.replace(
            start, x_m=start.x_m + start.speed_mps * step * self.mission.dt_s
        )


class MergeIn:
    """The scenario: the truck on a ramp that ends, two cars on the adjacent main lane."""

    Parameters = MergeInParameters

    def __call__(self, parameters: MergeInParameters, seed: int) -> MergeInSituation:  # noqa: ARG002 - the contract's; nothing is random here
        """Return the situation for some parameters; nothing in it is random."""
        speed_mps = parameters.traffic_speed_mps
        second_x_m = (
            -parameters.behind_m - (scenarios.TRUCK_LENGTH_M + scenarios.CAR_LENGTH_M) / 2.0
        )
        first_x_m = second_x_m + parameters.gap_s * speed_mps + scenarios.CAR_LENGTH_M
        return MergeInSituation(
            mission=scenarios.make_mission(
                DESIRED_SPEED_MPS, GOAL_M, 0.5 * scenarios.TRUCK_LENGTH_M + parameters.ramp_m
            ),
            steps=STEPS,
            ego=scenarios.make_truck(parameters.ego_speed_mps),
            actors=(
                scenarios.make_car(first_x_m, MAIN_LANE, speed_mps),
                scenarios.make_car(second_x_m, MAIN_LANE, speed_mps),
            ),
        )
