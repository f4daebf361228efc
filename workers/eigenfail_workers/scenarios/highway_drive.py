"""Highway drive: three successive challenges, each with a different cause of failure.

A phantom (a car alongside comes close and brakes while another one follows closely), a reveal (a
car ahead leaves the lane and reveals a slow one) and a cut-in. Each challenge begins at a fixed
time. Its cars are placed relative to the truck's position at that time, so that a challenge does
not depend on the truck's course through earlier ones.
"""

from typing import Annotated, Final

import msgspec
from msgspec import Meta

from eigenfail.contracts import TrafficModel
from eigenfail.values.scene import Mission, VehicleState
from eigenfail_workers import scenarios
from eigenfail_workers.measures.geometry import find_hidden
from eigenfail_workers.scenarios import traffic

STEPS: Final = 420
GOAL_M: Final = 3000.0
REVEAL_STEP: Final = 70
CUT_IN_STEP: Final = 270

PASSING, FOLLOWING, LEADING, SLOW, CUTTING_IN = range(1, 6)
"""Numbers of the vehicles."""

CHALLENGES: Final = ("phantom", "phantom", "reveal", "reveal", "cut-in")
"""Challenge of each vehicle, in the order of their numbers."""

# Gaps, times and speeds were tuned, with other seeds than any result's, towards a failure rate
# between 1e-4 and 1e-3 and at least 10 % of the failures from each of three causes (docs/world.md).
PASSING_GAP_M: Final = -22.0
PASSING_FASTER_MPS: Final = 4.0
PASSING_BRAKES: Final = traffic.SpeedChange(begins_s=5.0, lasts_s=4.5, acceleration_mps2=-4.0)
# Within 2 s the phantom would be far more frequent: the tracker's lateral speed lags behind.
APPROACH_BEGINS_S, APPROACH_LASTS_S = 0.0, 4.0
RETURN_BEGINS_S, RETURN_LASTS_S = 7.0, 1.5

FOLLOWER_LAW: Final = traffic.FollowerLaw(
    gain_per_s=1.0,
    gap_gain_per_s2=0.15,
    delay_steps=10,
    hardest_mps2=-5.0,
    strongest_mps2=1.5,
)
DROPS_BACK_MPS: Final = 8.0
"""Growth of the follower's desired gap after the phantom."""

LEADING_GAP_M: Final = 25.0
LEADING_SHIFT: Final = traffic.LateralShift(begins_s=2.0, lasts_s=3.0, way_m=scenarios.LANE_WIDTH_M)
SLOWER_MPS: Final = 12.0
SLOW_DRIVES_ON: Final = traffic.SpeedChange(begins_s=8.0, lasts_s=6.0, acceleration_mps2=2.0)

CUT_IN_GAP_M: Final = 94.0
CUT_IN_LASTS_S: Final = 3.0
CUT_IN_OFFSET_M: Final = 2.1

LEAST_SPEED_MPS: Final = 3.0
"""Least speed of the slow car and of the car that cuts in, whatever the truck's speed is."""

GONE_AHEAD_M, GONE_BEHIND_M = 150.0, 20.0
"""Bumper to bumper: a car that is farther away from the truck than this is gone for good."""


class HighwayDriveParameters(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """Parameters of the scenario. Gaps are between bumpers.

    Attributes:
        ego_speed_mps: speed of the truck at the start, and its desired speed.
        passing_offset_m: distance between the centre lines of truck and passing car, once that has
            come close.
        follower_gap_m: gap of the follower at the start, which it desires to keep.
        slow_gap_m: gap of the slow car at the beginning of the reveal.
        cut_in_distance_m: gap at which the car begins to cut in, for an ego at constant speed.
    """

    ego_speed_mps: Annotated[
        float, Meta(ge=23.5, le=24.5, description="Speed of the truck at the start [m/s].")
    ] = 24.0
    passing_offset_m: Annotated[
        float,
        Meta(ge=2.88, le=3.1, description="Passing car at its closest, from the truck's line [m]."),
    ] = 2.97
    follower_gap_m: Annotated[
        float, Meta(ge=8.0, le=11.0, description="Gap to the follower at the start [m].")
    ] = 9.0
    slow_gap_m: Annotated[
        float,
        Meta(
            ge=77.0,
            le=84.0,
            description="Gap to the slow car when the reveal begins [m].",
            extra={"nearby": 1.0},
        ),
    ] = 78.5
    cut_in_distance_m: Annotated[
        float, Meta(ge=53.0, le=60.0, description="Gap at which the car begins to come over [m].")
    ] = 57.0


class HighwayDriveSituation(msgspec.Struct, frozen=True):
    """A drive with its parameters filled in (contract `ReactiveSituation`)."""

    mission: Mission
    steps: int
    ego: VehicleState
    actors: tuple[VehicleState, ...]
    parameters: HighwayDriveParameters
    challenges: tuple[str, ...] = CHALLENGES

    def start_traffic(self) -> TrafficModel:
        """Return the cars of a new episode."""
        return DriveTraffic(self)


class DriveTraffic:
    """The cars of one episode of a drive (contract `TrafficModel`)."""

    def __init__(self, situation: HighwayDriveSituation) -> None:
        self._parameters = situation.parameters
        self._follower: traffic.FollowingCar | None = traffic.FollowingCar(
            situation.actors[1], FOLLOWER_LAW, scenarios.DT_S
        )
        self._cars = {PASSING: (0, make_passing_car(situation.parameters))}
        self._is_slow_revealed = False

    def advance(self, step: int, ego: VehicleState) -> dict[int, VehicleState]:
        """Return the cars that are there after a step."""
        there: dict[int, VehicleState] = {}
        self._begin_challenge(step, ego)
        for number, (first, car) in self._cars.items():
            there[number] = car.find_state((step - first) * scenarios.DT_S)
        if self._follower is not None:
            # After the phantom the follower drops back, out of the way of the other challenges.
            since_s = max(step - REVEAL_STEP, 0) * scenarios.DT_S
            desired_gap_m = self._parameters.follower_gap_m + DROPS_BACK_MPS * since_s
            self._follower.follow(ego, desired_gap_m)
            there[FOLLOWING] = self._follower.state
        self._hide_slow(there, ego)
        self._remove_far_cars(there, ego)
        return there

    def _begin_challenge(self, step: int, ego: VehicleState) -> None:
        front_m = ego.x_m + 0.5 * (scenarios.TRUCK_LENGTH_M + scenarios.CAR_LENGTH_M)
        # Relative to the truck's present speed, so that each challenge is as hard however it got
        # here.
        slow_mps = max(ego.speed_mps - SLOWER_MPS, LEAST_SPEED_MPS)
        if step == REVEAL_STEP:
            leading = traffic.PlannedCar(
                front_m + LEADING_GAP_M, 0.0, ego.speed_mps, shifts=(LEADING_SHIFT,)
            )
            gap_m = self._parameters.slow_gap_m
            slow = traffic.PlannedCar(front_m + gap_m, 0.0, slow_mps, SLOW_DRIVES_ON)
            self._cars |= {LEADING: (step, leading), SLOW: (step, slow)}
        elif step == CUT_IN_STEP:
            closing_mps = ego.speed_mps - slow_mps
            way_m = CUT_IN_GAP_M - self._parameters.cut_in_distance_m
            shift = traffic.LateralShift(
                # A truck that has slowed down to the car's speed would never come near: it then
                # begins anyway.
                way_m / max(closing_mps, 1.0),
                CUT_IN_LASTS_S,
                CUT_IN_OFFSET_M - scenarios.LANE_WIDTH_M,
            )
            car = traffic.PlannedCar(
                front_m + CUT_IN_GAP_M, scenarios.LANE_WIDTH_M, slow_mps, shifts=(shift,)
            )
            self._cars[CUTTING_IN] = (step, car)

    def _hide_slow(self, there: dict[int, VehicleState], ego: VehicleState) -> None:
        """Leave out the slow car until the car ahead of it first lets a part of it be seen."""
        if SLOW not in there or self._is_slow_revealed:
            return
        slow = there.pop(SLOW)
        self._is_slow_revealed = 1 not in find_hidden(ego, (there[LEADING], slow))
        if self._is_slow_revealed:
            there[SLOW] = slow

    def _remove_far_cars(self, there: dict[int, VehicleState], ego: VehicleState) -> None:
        """Leave out, for good, cars that are far away; one car at least always stays."""
        between_m = 0.5 * (scenarios.TRUCK_LENGTH_M + scenarios.CAR_LENGTH_M)
        for number, car in list(there.items()):
            way_m = car.x_m - ego.x_m
            is_far = way_m > GONE_AHEAD_M + between_m or way_m < -GONE_BEHIND_M - between_m
            # Noise is on the position of the nearest vehicle: there must be one in every step.
            if is_far and len(there) > 1:
                del there[number]
                self._cars.pop(number, None)
                if number == FOLLOWING:
                    self._follower = None


def make_passing_car(parameters: HighwayDriveParameters) -> traffic.PlannedCar:
    """Return the car of the phantom: it passes on the left, comes close, and brakes."""
    way_m = parameters.passing_offset_m - scenarios.LANE_WIDTH_M
    return traffic.PlannedCar(
        PASSING_GAP_M + 0.5 * (scenarios.TRUCK_LENGTH_M + scenarios.CAR_LENGTH_M),
        scenarios.LANE_WIDTH_M,
        parameters.ego_speed_mps + PASSING_FASTER_MPS,
        PASSING_BRAKES,
        (
            traffic.LateralShift(APPROACH_BEGINS_S, APPROACH_LASTS_S, way_m),
            traffic.LateralShift(RETURN_BEGINS_S, RETURN_LASTS_S, -way_m),
        ),
    )


class HighwayDrive:
    """The scenario: two lanes, the truck on the right one, five cars around it in turn."""

    Parameters = HighwayDriveParameters

    def __call__(self, parameters: HighwayDriveParameters, seed: int) -> HighwayDriveSituation:  # noqa: ARG002 - the contract's; nothing is random here
        """Return the situation for some parameters; nothing in it is random."""
        speed_mps = parameters.ego_speed_mps
        follower_x_m = -parameters.follower_gap_m - 0.5 * (
            scenarios.TRUCK_LENGTH_M + scenarios.CAR_LENGTH_M
        )
        return HighwayDriveSituation(
            mission=scenarios.make_mission(speed_mps, GOAL_M),
            steps=STEPS,
            ego=scenarios.make_truck(speed_mps),
            actors=(
                make_passing_car(parameters).find_state(0.0),
                scenarios.make_car(follower_x_m, 0, speed_mps),
            ),
            parameters=parameters,
        )
