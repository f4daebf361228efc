"""What all scenarios are staged with: time, road, truck and cars."""

from eigenfail.values import VehicleState

DT_S = 0.1
LANES = 2
LANE_WIDTH_M = 3.5
SPEED_LIMIT_MPS = 25.0
TRUCK_LENGTH_M, TRUCK_WIDTH_M = 16.0, 2.5
CAR_LENGTH_M, CAR_WIDTH_M = 5.0, 2.0


def truck(speed_mps: float) -> VehicleState:
    """The ego: its centre at the origin, in the middle of lane 0, along the road."""
    return VehicleState(0.0, 0.0, 0.0, speed_mps, TRUCK_LENGTH_M, TRUCK_WIDTH_M)


def car(x_m: float, lane: int, speed_mps: float) -> VehicleState:
    """A car in the middle of a lane, along the road."""
    return VehicleState(x_m, lane * LANE_WIDTH_M, 0.0, speed_mps, CAR_LENGTH_M, CAR_WIDTH_M)
