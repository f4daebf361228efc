"""Cut-in: a slow car changes into the truck's lane ahead of it (paper, fig. 1)."""

from math import atan2, hypot
from typing import Annotated

import msgspec
from msgspec import Meta

from eigenfail.values import Mission, VehicleState

DT_S = 0.1
STEPS = 100
LANES = 2
LANE_WIDTH_M = 3.5
SPEED_LIMIT_MPS = 25.0
GOAL_M = 1000.0
TRUCK_LENGTH_M, TRUCK_WIDTH_M = 16.0, 2.5
CAR_LENGTH_M, CAR_WIDTH_M = 5.0, 2.0


class CutInParameters(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What can be varied.

    Gaps are between the truck's front and the car's rear bumper.

    Attributes:
        distance_m: gap at which the lane change begins, for an ego that kept its speed until then:
            the car follows its script, so that noise cannot move the moment.
    """

    distance_m: Annotated[
        float, Meta(ge=48.0, le=70.0, description="Gap at which the lane change begins [m].")
    ] = 58.0
    initial_gap_m: Annotated[
        float, Meta(ge=80.0, le=120.0, description="Gap at the start [m].")
    ] = 94.0
    ego_speed_mps: Annotated[
        float, Meta(ge=22.0, le=25.0, description="Speed of the truck at the start [m/s].")
    ] = 24.0
    actor_speed_mps: Annotated[
        float, Meta(ge=11.0, le=16.0, description="Speed of the car along the road [m/s].")
    ] = 12.0
    lane_change_s: Annotated[
        float, Meta(ge=5.0, le=9.0, description="Duration of the lane change [s].")
    ] = 7.0


class CutInSituation(msgspec.Struct, frozen=True):
    """A cut-in with its parameters filled in (contract `Situation`).

    Attributes:
        change_begins_s: when the car leaves its lane.
        change_lasts_s: how long until it is centred in the truck's lane.
    """

    mission: Mission
    steps: int
    ego: VehicleState
    actors: tuple[VehicleState, ...]
    change_begins_s: float
    change_lasts_s: float

    def move_actor(self, actor: int, step: int, ego: VehicleState) -> VehicleState:  # noqa: ARG002 - the contract's; this script does not react to the ego
        """Where the car is after `step` steps: constant speed along the road, then over."""
        start = self.actors[actor]
        time_s = step * self.mission.dt_s
        share = (time_s - self.change_begins_s) / self.change_lasts_s
        done, rate = minimum_jerk(min(max(share, 0.0), 1.0))
        lateral_mps = -start.y_m * rate / self.change_lasts_s
        return msgspec.structs.replace(
            start,
            x_m=start.x_m + start.speed_mps * time_s,
            y_m=start.y_m * (1.0 - done),
            heading_rad=atan2(lateral_mps, start.speed_mps),
            speed_mps=hypot(start.speed_mps, lateral_mps),
        )


class CutIn:
    """The scenario: two lanes, the truck on the right one, a slower car on the left one."""

    Parameters = CutInParameters

    def __call__(self, parameters: CutInParameters, seed: int) -> CutInSituation:  # noqa: ARG002 - the contract's; nothing is random here
        """The situation for these parameters; nothing in it is random."""
        closing_mps = parameters.ego_speed_mps - parameters.actor_speed_mps
        actor_x_m = parameters.initial_gap_m + (TRUCK_LENGTH_M + CAR_LENGTH_M) / 2.0
        return CutInSituation(
            mission=_mission(parameters),
            steps=STEPS,
            ego=VehicleState(
                0.0, 0.0, 0.0, parameters.ego_speed_mps, TRUCK_LENGTH_M, TRUCK_WIDTH_M
            ),
            actors=(
                VehicleState(
                    actor_x_m,
                    LANE_WIDTH_M,
                    0.0,
                    parameters.actor_speed_mps,
                    CAR_LENGTH_M,
                    CAR_WIDTH_M,
                ),
            ),
            change_begins_s=(parameters.initial_gap_m - parameters.distance_m) / closing_mps,
            change_lasts_s=parameters.lane_change_s,
        )


def minimum_jerk(share: float) -> tuple[float, float]:
    """The quintic from 0 to 1 of least jerk, and its slope, at a share of the time in [0, 1]."""
    done = share**3 * (10.0 - 15.0 * share + 6.0 * share**2)
    return done, 30.0 * (share * (1.0 - share)) ** 2


def _mission(parameters: CutInParameters) -> Mission:
    return Mission(
        dt_s=DT_S,
        lanes=LANES,
        lane_width_m=LANE_WIDTH_M,
        speed_limit_mps=SPEED_LIMIT_MPS,
        desired_speed_mps=parameters.ego_speed_mps,
        goal_x_m=GOAL_M,
    )
