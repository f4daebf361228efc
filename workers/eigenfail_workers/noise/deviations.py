"""Standard deviations of the disturbances at the true distances."""

from math import hypot, inf
from struct import Struct

from eigenfail.errors import SimulatorError
from eigenfail.values.arrays import LARGEST_FLOAT32
from eigenfail.values.channels import Channel, split_name
from eigenfail.values.disturbance import DisturbanceModel
from eigenfail.values.scene import Observation
from eigenfail.values.shapes import MOST_LIKELY, Markov, Row
from eigenfail_workers.perception import EGO, find_target

_SINGLE = Struct("<f")

_ALONG, _ACROSS, _APART = range(3)
_DISTANCES = {"longitudinal": _ALONG, "lateral": _ACROSS}


def to_float32(value: float) -> float:
    """Return the float32 nearest to a value, as a Python float.

    Raises:
        SimulatorError: the value is beyond the range of float32.
    """
    try:
        (rounded,) = _SINGLE.unpack(_SINGLE.pack(value))
    except OverflowError as error:
        remedy = f"Deviations are kept up to {LARGEST_FLOAT32:g}: look at distances and the model."
        raise SimulatorError(f"A standard deviation would be {value:g}.", remedy) from error
    return float(rounded)


class Deviations:
    """Finds sigma of each channel of a disturbance model, in the channels' units.

    Sigma is rounded to float32, because float32 is stored: a replay must inject exactly the same
    values.
    """

    def __init__(self, model: DisturbanceModel) -> None:
        self._terms = [_make_term(channel, model.scale) for channel in model.list_channels()]

    def compute(self, observation: Observation, actor: int) -> Row:
        """Return sigma at the true distances between centres.

        For an event it is 1 or, if the probability that the event begins depends on the distance,
        this probability. A vehicle that is not there counts as if it were at the ego.

        Args:
            observation: the truth.
            actor: index of the nearest vehicle.
        """
        ego, others = observation.ego, observation.others
        found = []
        for target, distance, slope, base, scale, most in self._terms:
            if base == 0.0:
                found.append(1.0)
                continue
            place = actor if target < 0 else target
            # Vehicles that come and go change their places, but keep their numbers.
            if target >= 0 and observation.ids is not None:
                place = _find_place(observation.ids, target + 1)
            # The ego in place of another vehicle makes every distance 0.
            other = ego if target == EGO or place < 0 else others[place]
            dx, dy = abs(other.x_m - ego.x_m), abs(other.y_m - ego.y_m)
            apart_m = dx if distance == _ALONG else dy if distance == _ACROSS else hypot(dx, dy)
            found.append(to_float32(min(scale * (slope * apart_m + base), most)))
        return tuple(found)


def _find_place(ids: tuple[int, ...], number: int) -> int:
    """Return the place of a vehicle by its number, from 1; -1 if it is not there."""
    return ids.index(number) if number in ids else -1


def _make_term(channel: Channel, scale: float) -> tuple[int, int, float, float, float, float]:
    """Return target, kind of distance, slope, base, scale and largest value of a channel.

    The base of an event with a constant rate is 0.
    """
    _, quantity = split_name(channel.name)
    distance = _DISTANCES.get(quantity, _APART)
    target, shape = find_target(channel.name), channel.shape
    if isinstance(shape, Markov) and shape.growth_per_m:
        return target, distance, shape.growth_per_m, shape.rate, 1.0, MOST_LIKELY
    slope, base = channel.sigma_per_m or 0.0, channel.sigma or 0.0
    return target, distance, slope, base, scale, inf
