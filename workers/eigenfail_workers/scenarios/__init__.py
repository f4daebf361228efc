"""The scenarios that come with eigenfail."""

from eigenfail.values.scene import Mission, VehicleState

DT_S = 0.1


LANES = 2


LANE_WIDTH_M = 3.5


SPEED_LIMIT_MPS = 25.0


TRUCK_LENGTH_M, TRUCK_WIDTH_M = 16.0, 2.5


CAR_LENGTH_M, CAR_WIDTH_M = 5.0, 2.0


def make_mission(
    desired_speed_mps: float, goal_x_m: float, lane_0_ends_x_m: float | None = None
) -> Mission:
    """Return the mission on the road that all scenarios share."""
    return Mission(
        dt_s=DT_S,
        lanes=LANES,
        lane_width_m=LANE_WIDTH_M,
        speed_limit_mps=SPEED_LIMIT_MPS,
        desired_speed_mps=desired_speed_mps,
        goal_x_m=goal_x_m,
        lane_0_ends_x_m=lane_0_ends_x_m,
    )


def make_truck(speed_mps: float) -> VehicleState:
    """Return the ego with its centre at the origin, in the centre of lane 0, along the road."""
    return VehicleState(0.0, 0.0, 0.0, speed_mps, TRUCK_LENGTH_M, TRUCK_WIDTH_M)


def make_car(x_m: float, lane: int, speed_mps: float) -> VehicleState:
    """Return a car in the centre of a lane, along the road."""
    return VehicleState(x_m, lane * LANE_WIDTH_M, 0.0, speed_mps, CAR_LENGTH_M, CAR_WIDTH_M)
