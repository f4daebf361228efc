"""A scenario of one's own: the truck comes upon the end of a queue. docs/own_scenario.md"""

from typing import Annotated

import msgspec
from msgspec import Meta

from eigenfail.values.scene import Mission, VehicleState

DT_S = 0.1
STEPS = 200
TRUCK_M, CAR_M = (16.0, 2.5), (5.0, 2.0)


class QueueParameters(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """What a campaign may set under `scenario_parameters`; outside the bounds it is refused."""

    gap_m: Annotated[float, Meta(ge=180.0, le=260.0, description="Gap at the start [m].")] = 200.0
    ego_speed_mps: Annotated[
        float, Meta(ge=17.0, le=21.0, description="Speed of the truck at the start [m/s].")
    ] = 20.0
    queue_speed_mps: Annotated[
        float, Meta(ge=2.0, le=8.0, description="Speed at which the queue moves up [m/s].")
    ] = 4.0
    spacing_m: Annotated[
        float, Meta(ge=2.0, le=15.0, description="Gap between two cars of the queue [m].")
    ] = 5.0
    cars: Annotated[int, Meta(ge=1, le=5, description="Cars in the queue.")] = 3


class QueueSituation(msgspec.Struct, frozen=True):
    """The queue with its parameters filled in (contract `Situation`)."""

    mission: Mission
    steps: int
    ego: VehicleState
    actors: tuple[VehicleState, ...]

    def move_actor(self, actor: int, step: int, ego: VehicleState) -> VehicleState:  # noqa: ARG002 - the contract's; the queue does not look behind
        """Where a car is after `step` steps: it moves up as fast as it did."""
        start = self.actors[actor]
        way_m = start.speed_mps * step * self.mission.dt_s
        return msgspec.structs.replace(start, x_m=start.x_m + way_m)


class QueueEnd:
    """The scenario: two lanes, a queue in the truck's own, its last car first."""

    Parameters = QueueParameters

    def __call__(self, parameters: QueueParameters, seed: int) -> QueueSituation:  # noqa: ARG002 - nothing is random here
        """The situation for these parameters; what is random in one must come from the seed."""
        last_x_m = parameters.gap_m + (TRUCK_M[0] + CAR_M[0]) / 2.0
        every_m = parameters.spacing_m + CAR_M[0]
        return QueueSituation(
            mission=Mission(
                dt_s=DT_S,
                lanes=2,
                lane_width_m=3.5,
                speed_limit_mps=25.0,
                desired_speed_mps=parameters.ego_speed_mps,
                goal_x_m=2000.0,
            ),
            steps=STEPS,
            ego=VehicleState(0.0, 0.0, 0.0, parameters.ego_speed_mps, *TRUCK_M),
            actors=tuple(
                VehicleState(last_x_m + n * every_m, 0.0, 0.0, parameters.queue_speed_mps, *CAR_M)
                for n in range(parameters.cars)
            ),
        )
