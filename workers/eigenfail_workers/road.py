"""The road of a mission, and whether somebody is still on it."""

from eigenfail.values import Mission, VehicleState


def is_off_road(mission: Mission, vehicle: VehicleState) -> bool:
    """Whether the centre of a vehicle is beside the outer lanes or behind the end of its lane.

    Lane n reaches from (n - 1/2) to (n + 1/2) lane widths across the road. A lane 0 that ends is
    the only one that does; beyond its end there is road only from lane 1 on.
    """
    lane = vehicle.y_m / mission.lane_width_m
    if not -0.5 <= lane <= mission.lanes - 0.5:
        return True
    ends_x_m = mission.lane_0_ends_x_m
    return ends_x_m is not None and lane < 0.5 and vehicle.x_m > ends_x_m
