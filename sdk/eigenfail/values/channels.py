"""Channels: named ways in which perception may be wrong, each with a model of its error.

`speed` is an error of the speed of the nearest vehicle, `vehicle_2.speed` of the second one of the
scenario, `every.speed` of each of them, with noise of its own, and `ego.speed` of the ego itself.
"""

import re
from collections.abc import Mapping
from types import MappingProxyType
from typing import Annotated, NamedTuple

import msgspec
from msgspec import Meta
from msgspec.structs import replace

from eigenfail.errors import InvalidValue, UnknownName
from eigenfail.values.shapes import ChannelShape, Markov, White

FIELD = "disturbance.channels"

NEAREST, EGO, EVERY, VEHICLE = "", "ego", "every", "vehicle_"
"""Targets of a channel, before the dot; vehicles are numbered from 1."""

MISSED = "missed"


class Quantity(NamedTuple):
    """What of a perceived vehicle a channel disturbs.

    Attributes:
        unit: unit of the error; empty for an event.
        sigma: default standard deviation at no distance, in that unit.
        sigma_per_m: by how much it grows with each metre of distance.
        of_ego: whether the ego perceives it of itself.
    """

    unit: str
    sigma: float | None
    sigma_per_m: float | None
    of_ego: bool


QUANTITIES: Mapping[str, Quantity] = MappingProxyType(
    {
        "longitudinal": Quantity("m", 1.0, 0.02, of_ego=True),
        "lateral": Quantity("m", 0.2, 0.00625, of_ego=True),
        "heading": Quantity("rad", 0.02, 0.0, of_ego=True),
        "speed": Quantity("m/s", 0.5, 0.0, of_ego=True),
        "length": Quantity("m", 0.2, 0.0, of_ego=False),
        "width": Quantity("m", 0.1, 0.0, of_ego=False),
        MISSED: Quantity("", None, None, of_ego=False),
    }
)
"""By name. The defaults of a position are the paper's; the others are round numbers, for which a
campaign substitutes those of its sensor."""

UNIT_SUFFIXES: Mapping[str, str] = MappingProxyType({"m": "_m", "rad": "_rad", "m/s": "_mps"})
"""What the names of columns end in, by unit."""

ALL_CHANNELS = frozenset(
    name
    for quantity, kind in QUANTITIES.items()
    for name in (quantity, f"{EVERY}.{quantity}", *((f"{EGO}.{quantity}",) if kind.of_ego else ()))
)
"""The channels that a simulation can have, where one of every vehicle stands for each of them."""

POSITION_CHANNELS = frozenset({"longitudinal", "lateral"})
"""The channels of a simulation that disturbs the position of the nearest vehicle alone."""

_VEHICLE = re.compile(r"vehicle_([1-9][0-9]{0,2})")


class ChannelName(NamedTuple):
    """The two parts of the name of a channel."""

    target: str
    quantity: str

    @property
    def vehicle(self) -> int | None:
        """Number of the vehicle that it names, from 1; None where it names none."""
        match = _VEHICLE.fullmatch(self.target)
        return int(match[1]) if match else None


def split_name(name: str) -> ChannelName:
    """Return target and quantity of a channel."""
    target, _, quantity = name.rpartition(".")
    return ChannelName(target, quantity)


def find_quantity(name: str) -> Quantity:
    """Return what a channel disturbs.

    Raises:
        UnknownName: there is no such quantity.
    """
    quantity = QUANTITIES.get(split_name(name).quantity)
    if quantity is None:
        raise UnknownName(FIELD, name, ALL_CHANNELS)
    return quantity


def find_unit_suffix(name: str) -> str:
    """Return what names of columns with the errors of a channel end in; empty without a unit.

    Channels of functions may have any names, and most have none of these.
    """
    quantity = QUANTITIES.get(split_name(name).quantity)
    return "" if quantity is None else UNIT_SUFFIXES.get(quantity.unit, "")


class Channel(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A channel of the noise, with the model of its error.

    The error is a_t = sigma_t · u_t, with u = shape(z) and sigma_t = sigma + sigma_per_m · d, times
    the `scale` of the disturbance model. d is the true distance between the centres of the ego and
    the vehicle [m]: along the road for `longitudinal`, across it for `lateral`, in the plane for
    the others, and 0 for the ego itself. While the event of `missed` lasts, the vehicle is absent
    from what the planner perceives.

    Attributes:
        name: target and quantity; see `QUANTITIES`.
        sigma: standard deviation at no distance, in the unit of the quantity; None: the default of
            the quantity. An event has none.
        sigma_per_m: by how much it grows with each metre of distance; None as above.
        shape: how u follows from z; None: white noise, and `markov` for an event.
    """

    name: Annotated[str, Meta(min_length=1, max_length=40)]
    sigma: Annotated[float, Meta(gt=0.0, le=100.0)] | None = None
    sigma_per_m: Annotated[float, Meta(ge=0.0, le=10.0)] | None = None
    shape: ChannelShape | None = None

    @property
    def is_event(self) -> bool:
        """Whether it is an event, which has no sigma."""
        return split_name(self.name).quantity == MISSED

    @property
    def unit(self) -> str:
        """Unit of the error; empty for an event."""
        return find_quantity(self.name).unit

    def filled(self) -> "Channel":
        """Return the channel with the defaults of its quantity written out."""
        quantity = find_quantity(self.name)
        default = Markov() if self.is_event else White()
        return Channel(
            self.name,
            quantity.sigma if self.sigma is None else self.sigma,
            quantity.sigma_per_m if self.sigma_per_m is None else self.sigma_per_m,
            default if self.shape is None else self.shape,
        )

    def in_words(self) -> str:
        """What people read of a channel that is filled."""
        words = "" if self.shape is None else self.shape.in_words()
        if self.is_event:
            return words
        growth = f"{self.sigma_per_m:g}·d + " if self.sigma_per_m else ""
        return f"sigma {growth}{self.sigma:g} {self.unit}; {words}"


def resolve_channels(
    channels: tuple[Channel, ...], vehicles: int, offered: frozenset[str]
) -> tuple[Channel, ...]:
    """Return the channels with defaults written out, and those of every vehicle one by one.

    Args:
        channels: as a campaign gives them.
        vehicles: number of vehicles besides the ego.
        offered: channels that the simulator can inject, in the terms of `ALL_CHANNELS`.

    Raises:
        UnknownName: the simulator offers no such channel, or there is no such vehicle.
        InvalidValue: a channel is named twice, has the shape of another kind of channel, or is an
            event with a sigma.
    """
    known = list_names(vehicles, offered)
    for place, channel in enumerate(channels):
        if channel.name not in known:
            raise UnknownName(f"{FIELD}[{place}].name", channel.name, known)
        _check_model(channel, f"{FIELD}[{place}]")
    resolved = tuple(one.filled() for channel in channels for one in _expand(channel, vehicles))
    names = [channel.name for channel in resolved]
    if twice := [name for place, name in enumerate(names) if name in names[:place]]:
        problem = f"'{twice[0]}' is there twice."
        raise InvalidValue(FIELD, problem, "Name each channel once; `every.` names all vehicles.")
    return resolved


def list_names(vehicles: int, offered: frozenset[str]) -> list[str]:
    """Return the names that a campaign may use with a simulator, for that many vehicles."""
    each = [name for name in offered if split_name(name).target == EVERY]
    numbered = [
        f"{VEHICLE}{number}.{split_name(name).quantity}"
        for name in each
        for number in range(1, vehicles + 1)
    ]
    return sorted([*offered, *numbered])


def _expand(channel: Channel, vehicles: int) -> list[Channel]:
    target, quantity = split_name(channel.name)
    if target != EVERY:
        return [channel]
    numbers = range(1, vehicles + 1)
    return [replace(channel, name=f"{VEHICLE}{number}.{quantity}") for number in numbers]


def _check_model(channel: Channel, field: str) -> None:
    if channel.is_event and (channel.sigma is not None or channel.sigma_per_m is not None):
        problem = f"'{channel.name}' is an event, which has no standard deviation."
        raise InvalidValue(f"{field}.sigma", problem, "Set rate and mean_steps of its shape.")
    if channel.shape is not None and isinstance(channel.shape, Markov) != channel.is_event:
        wanted = "markov" if channel.is_event else "white, ar1 or student_t"
        problem = f"the noise of '{channel.name}' cannot have this shape."
        raise InvalidValue(f"{field}.shape", problem, f"Take {wanted}.")
