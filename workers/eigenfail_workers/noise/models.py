"""How large the noise is (paper, eq. 2 and 3)."""

from eigenfail.values import DisturbanceModel, VehicleState
from eigenfail_workers.noise.rounding import to_float32

Pair = tuple[float, float]


def deviations(model: DisturbanceModel, ego: VehicleState, actor: VehicleState) -> Pair:
    """sigma_x and sigma_y at the true distances of the two centres, rounded to float32. [m]

    Rounded because float32 is what is stored: a replay must inject the very same metres.
    """
    dx, dy = abs(actor.x_m - ego.x_m), abs(actor.y_m - ego.y_m)
    return (
        to_float32(model.scale * (model.longitudinal_slope * dx + model.longitudinal_base_m)),
        to_float32(model.scale * (model.lateral_slope * dy + model.lateral_base_m)),
    )
