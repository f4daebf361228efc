"""Standard deviations of the disturbances at the true distances."""

from struct import Struct

from eigenfail.values import DisturbanceModel, VehicleState
from eigenfail.values.disturbance import Pair

_SINGLE = Struct("<f")


def to_float32(value: float) -> float:
    """Return the float32 nearest to a value, as a Python float.

    Raises:
        OverflowError: the value is beyond the range of float32.
    """
    (rounded,) = _SINGLE.unpack(_SINGLE.pack(value))
    return float(rounded)


def compute_deviations(model: DisturbanceModel, ego: VehicleState, actor: VehicleState) -> Pair:
    """Return sigma_x and sigma_y at the true distances of the two centres, as float32. [m]

    Rounded because float32 is stored: a replay must inject exactly the same metres.
    """
    dx, dy = abs(actor.x_m - ego.x_m), abs(actor.y_m - ego.y_m)
    return (
        to_float32(model.scale * (model.longitudinal_slope * dx + model.longitudinal_base_m)),
        to_float32(model.scale * (model.lateral_slope * dy + model.lateral_base_m)),
    )
