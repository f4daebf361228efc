"""The disturbance model: how large the noise is, and what shape it has."""

from typing import Annotated

import msgspec

from eigenfail.values.disturbance.shapes import Shape, White


class DisturbanceModel(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """a_t = sigma_t · u_t, sigma growing with the distance (paper, eq. 2 and 3).

    sigma_x = scale · (longitudinal_slope · |dx| + longitudinal_base_m), and the same for y. [m]
    u = shape(z), with z independent and standard normal; with the default shape, u = z: the
    paper's a_t ~ N(0, diag(sigma_x², sigma_y²)).

    Attributes:
        scale: multiplies both sigmas: what the margin of a sensor's specification is asked in.
        shape: makes the standardised noise u of z, in unit variance.
    """

    longitudinal_slope: Annotated[float, msgspec.Meta(ge=0.0, le=1.0)] = 0.02
    longitudinal_base_m: Annotated[float, msgspec.Meta(gt=0.0, le=100.0)] = 1.0
    lateral_slope: Annotated[float, msgspec.Meta(ge=0.0, le=1.0)] = 0.00625
    lateral_base_m: Annotated[float, msgspec.Meta(gt=0.0, le=100.0)] = 0.2
    scale: Annotated[float, msgspec.Meta(gt=0.0, le=10.0)] = 1.0
    shape: Shape = White()

    def in_words(self) -> dict[str, str]:
        """What people read, by name."""
        along, across = self.longitudinal_base_m, self.lateral_base_m
        return {
            "longitudinal sigma": f"{self.longitudinal_slope:g}·|dx| + {along:g} m",
            "lateral sigma": f"{self.lateral_slope:g}·|dy| + {across:g} m",
            "scale": f"both sigmas × {self.scale:g}",
            "shape": self.shape.in_words(),
        }
