"""The disturbance model p(x), what is drawn from it, and what is injected."""

from eigenfail.values.disturbance.conversion import Conversion
from eigenfail.values.disturbance.model import DisturbanceModel
from eigenfail.values.disturbance.shapes import Correlated, HeavyTailed, Shape, White
from eigenfail.values.disturbance.trajectory import AXES, NoiseTrajectory

__all__ = [
    "AXES",
    "Conversion",
    "Correlated",
    "DisturbanceModel",
    "HeavyTailed",
    "NoiseTrajectory",
    "Shape",
    "White",
]
