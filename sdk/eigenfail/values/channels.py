"""Channels: named errors of perception, each with an error model.

`speed` is an error in the speed of the nearest vehicle, `vehicle_2.speed` in the speed of the
scenario's second vehicle, and `ego.speed` in the speed of the ego. `every.speed` is an error in the
speed of every vehicle, with independent noise for each. `delay` is the age at which the ego
perceives other vehicles, constant during an episode. `scenario.distance_m` is not an error: it
makes the draw of that parameter a part of the search. `observation.3` is an error in a number to
which the simulator gives this name.
"""

import re
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Annotated, NamedTuple

import msgspec
from msgspec import Meta
from msgspec.structs import replace

from eigenfail.errors import InvalidValue, UnknownName
from eigenfail.values.shapes import ChannelShape, Markov, Once, White

CHANNELS_FIELD = "disturbance.channels"
MOST_CHANNELS = 50

NEAREST, EGO, EVERY, VEHICLE, SCENARIO = "", "ego", "every", "vehicle_", "scenario"
OBSERVATION = "observation"
"""Targets of a channel, before the dot; vehicles are numbered from 1. The simulator names the
numbers in the observation of an environment."""

MISSED, GHOST, SWAPPED = "missed", "ghost", "swapped"
"""Events: a vehicle is not detected; a vehicle that does not exist is detected; the numbers of two
vehicles are exchanged."""

DELAY = "delay"
"""Age at which other vehicles are perceived."""


class Quantity(NamedTuple):
    """A quantity of a perceived vehicle that a channel disturbs.

    Attributes:
        unit: unit of the error; empty for an event.
        sigma: default standard deviation at no distance, in that unit.
        sigma_per_m: growth of the standard deviation with each metre of distance.
        targets: targets whose perception it may disturb.
    """

    unit: str
    sigma: float | None
    sigma_per_m: float | None
    targets: tuple[str, ...]


_OTHERS = (NEAREST, EVERY)
_ALL = (*_OTHERS, EGO)

QUANTITIES: Mapping[str, Quantity] = MappingProxyType(
    {
        "longitudinal": Quantity("m", 1.0, 0.02, _ALL),
        "lateral": Quantity("m", 0.2, 0.00625, _ALL),
        "heading": Quantity("rad", 0.02, 0.0, _ALL),
        "speed": Quantity("m/s", 0.5, 0.0, _ALL),
        "length": Quantity("m", 0.2, 0.0, _OTHERS),
        "width": Quantity("m", 0.1, 0.0, _OTHERS),
        MISSED: Quantity("", None, None, _OTHERS),
        GHOST: Quantity("", None, None, (NEAREST,)),
        SWAPPED: Quantity("", None, None, (NEAREST,)),
        DELAY: Quantity("s", 0.1, 0.0, (NEAREST,)),
    }
)
"""Quantities by name. The defaults of the position errors are the paper's. The others are round
numbers: in a campaign, replace them with the values of your sensor."""

PARAMETER_QUANTITY = Quantity("", None, None, (SCENARIO,))
"""A scenario parameter, which is chosen by the quantile of its own distribution."""

OBSERVED_QUANTITY = Quantity("", 1.0, 0.0, (OBSERVATION,))
"""A number that a simulator shows to a planner besides vehicles, in a unit of its own."""

_OWN_QUANTITIES = {SCENARIO: PARAMETER_QUANTITY, OBSERVATION: OBSERVED_QUANTITY}

GHOST_AHEAD_M = 40.0

UNIT_SUFFIXES: Mapping[str, str] = MappingProxyType(
    {"m": "_m", "rad": "_rad", "m/s": "_mps", "s": "_s"}
)
"""Suffixes of the names of columns, by unit."""

ALL_CHANNELS = frozenset(
    f"{target}.{name}".removeprefix(".")
    for name, quantity in QUANTITIES.items()
    for target in quantity.targets
)
"""Channels that a simulation can have; one channel of `every` represents all vehicles."""

# No leading zero: `vehicle_1` and `vehicle_01` would be two channels of one vehicle.
_VEHICLE = re.compile(r"vehicle_([1-9][0-9]{0,2})")


class ChannelName(NamedTuple):
    """The two parts of the name of a channel."""

    target: str
    quantity: str

    @property
    def vehicle(self) -> int | None:
        """Number of the vehicle in the target, from 1; None without one."""
        match = _VEHICLE.fullmatch(self.target)
        return int(match[1]) if match else None


def split_name(name: str) -> ChannelName:
    """Return the target and the quantity of a channel."""
    # At the last dot: names of functions' channels have none, and their target is then empty.
    target, _, quantity = name.rpartition(".")
    return ChannelName(target, quantity)


def find_quantity(name: str) -> Quantity:
    """Return the quantity that a channel disturbs.

    Raises:
        UnknownName: the quantity does not exist.
    """
    target, quantity_name = split_name(name)
    quantity = _OWN_QUANTITIES.get(target) or QUANTITIES.get(quantity_name)
    if quantity is None:
        raise UnknownName(CHANNELS_FIELD, name, ALL_CHANNELS)
    return quantity


class ChannelKind(NamedTuple):
    """The kind of a channel.

    Attributes:
        default_shape: its shape unless a campaign gives one.
        shapes: the shapes that it may have, by their `kind`.
        has_sigma: whether it has a standard deviation.
    """

    default_shape: ChannelShape
    shapes: tuple[str, ...]
    has_sigma: bool = False


ERROR = ChannelKind(White(), ("white", "ar1", "student_t"), has_sigma=True)
EVENT = ChannelKind(Markov(), ("markov",))
LATENCY = ChannelKind(Once(), ("once",), has_sigma=True)
PARAMETER = ChannelKind(Once(), ("once",))


KINDS: Mapping[str, ChannelKind] = MappingProxyType(
    {MISSED: EVENT, GHOST: EVENT, SWAPPED: EVENT, DELAY: LATENCY}
)
"""Kinds of the quantities that are not errors at each step."""


class ColumnNames(NamedTuple):
    """Names of the columns of a table with the noise of a channel."""

    z: str
    sigma: str
    error: str


def name_columns(name: str) -> ColumnNames:
    """Return the names of a channel's columns, with the unit as suffix if it is known.

    Channels of functions may have any names; for most of them, the unit is unknown.
    """
    target, quantity_name = split_name(name)
    # A parameter may be called `speed`, and has the unit that its scenario gives it.
    quantity = None if target in _OWN_QUANTITIES else QUANTITIES.get(quantity_name)
    suffix = "" if quantity is None else UNIT_SUFFIXES.get(quantity.unit, "")
    return ColumnNames(f"{name}_z", f"{name}_sigma{suffix}", f"{name}{suffix}")


class Channel(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """A channel of the noise, with the model of its error.

    The error is a_t = sigma_t · u_t, with u = shape(z) and sigma_t = sigma + sigma_per_m · d, times
    the `scale` of the disturbance model. d is the true distance between the centres of the ego and
    the vehicle [m]. It is measured along the road for `longitudinal`, across it for `lateral`, and
    in the plane for all further quantities. For the ego itself, d is 0.

    During a `missed` event, the planner does not perceive the vehicle. During a `ghost` event, it
    perceives a car at rest in the ego's lane, at the place of its first sighting. During a
    `swapped` event, the two vehicles nearest to the ego have each other's number. With a `delay`
    a_0, which is drawn once, the planner perceives every vehicle but the ego as it was |a_0|
    before, to the nearest step. A channel of the scenario also has one draw for the episode. Its
    parameter is the Phi(z_0)-quantile of the distribution that the campaign gives it.

    Attributes:
        name: target and quantity; see `QUANTITIES`.
        sigma: standard deviation at no distance, in the unit of the quantity; None: the default of
            the quantity. Give none for an event.
        sigma_per_m: growth of the standard deviation with each metre of distance; None: the default
            of the quantity.
        shape: how u follows from z; None: white noise, `markov` for an event, and `once` for a
            delay or a parameter of the scenario.
        ahead_m: for `ghost` only: distance from the ego's centre to the ghost when first seen.
    """

    name: Annotated[str, Meta(min_length=1, max_length=40)]
    sigma: Annotated[float, Meta(gt=0.0, le=100.0)] | None = None
    sigma_per_m: Annotated[float, Meta(ge=0.0, le=10.0)] | None = None
    shape: ChannelShape | None = None
    ahead_m: Annotated[float, Meta(gt=0.0, le=500.0)] | None = None

    @property
    def kind(self) -> ChannelKind:
        """The kind: an error at each step, an event, a delay, or a parameter of the scenario."""
        target, quantity = split_name(self.name)
        if target == SCENARIO:
            return PARAMETER
        return KINDS.get(quantity, ERROR)

    @property
    def unit(self) -> str:
        """Unit of the error; empty for an event."""
        return find_quantity(self.name).unit

    def filled(self) -> "Channel":
        """Return the channel with the defaults of its quantity written out."""
        quantity = find_quantity(self.name)
        shape = self.kind.default_shape if self.shape is None else self.shape
        if isinstance(shape, Markov) and not shape.growth_per_m:
            # A rate that grows by nothing is written as it was before it could grow.
            shape = replace(shape, rate_per_m=msgspec.UNSET)
        return Channel(
            self.name,
            quantity.sigma if self.sigma is None else self.sigma,
            quantity.sigma_per_m if self.sigma_per_m is None else self.sigma_per_m,
            shape,
            GHOST_AHEAD_M if self.name == GHOST and self.ahead_m is None else self.ahead_m,
        )

    def in_words(self) -> str:
        """Return the model in words; the channel must be filled."""
        words = "" if self.shape is None else self.shape.in_words()
        if not self.kind.has_sigma:
            return words if self.ahead_m is None else f"{self.ahead_m:g} m ahead; {words}"
        growth = f"{self.sigma_per_m:g}·d + " if self.sigma_per_m else ""
        return f"sigma {growth}{self.sigma:g} {self.unit}; {words}"


def resolve_channels(
    channels: tuple[Channel, ...],
    vehicles: int,
    offered: frozenset[str],
    parameters: Sequence[str] = (),
) -> tuple[Channel, ...]:
    """Return the checked channels with their defaults, and one channel for each vehicle of `every`.

    Args:
        channels: the channels as a campaign gives them.
        vehicles: number of vehicles besides the ego.
        offered: channels that the simulator can inject, named as in `ALL_CHANNELS`.
        parameters: names of the scenario's parameters that have a distribution.

    Raises:
        UnknownName: the simulator does not offer the channel, the vehicle does not exist, or no
            parameter of this name has a distribution.
        InvalidValue: a channel is named twice, has the shape of another kind of channel, is an
            event with a sigma, or needs more vehicles; or there are more than `MOST_CHANNELS`.
    """
    of_scenario = (f"{SCENARIO}.{name}" for name in parameters)
    known = [*list_names(vehicles, offered), *of_scenario]
    for place, channel in enumerate(channels):
        if channel.name not in known:
            raise UnknownName(f"{CHANNELS_FIELD}[{place}].name", channel.name, known)
        _check_model(channel, f"{CHANNELS_FIELD}[{place}]")
        if channel.name == SWAPPED and vehicles < 2:
            problem = f"'{SWAPPED}' exchanges the numbers of two vehicles, of which there is one."
            remedy = "Leave it out, or take a scenario with more vehicles."
            raise InvalidValue(f"{CHANNELS_FIELD}[{place}].name", problem, remedy)
    resolved = write_out(channels, vehicles)
    if len(resolved) > MOST_CHANNELS:
        problem = f"{len(resolved)} channels, one by one, are more than {MOST_CHANNELS}."
        raise InvalidValue(CHANNELS_FIELD, problem, "Name fewer, or single vehicles.")
    names = [channel.name for channel in resolved]
    if twice := [name for place, name in enumerate(names) if name in names[:place]]:
        problem = f"'{twice[0]}' is there twice."
        raise InvalidValue(
            CHANNELS_FIELD, problem, "Name each channel once; `every.` names all vehicles."
        )
    return resolved


def write_out(channels: tuple[Channel, ...], vehicles: int) -> tuple[Channel, ...]:
    """Return the channels with their defaults, and one channel for each vehicle of `every`."""
    return tuple(one.filled() for channel in channels for one in _expand(channel, vehicles))


def list_names(vehicles: int, offered: frozenset[str]) -> list[str]:
    """Return the channel names that a campaign may use with that many vehicles."""
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
    kind, given = channel.kind, channel.sigma is not None or channel.sigma_per_m is not None
    if kind is LATENCY and channel.sigma_per_m:
        problem = f"'{channel.name}' is the same for all vehicles, however far they are."
        raise InvalidValue(f"{field}.sigma_per_m", problem, "Leave it out.")
    if given and kind is PARAMETER:
        problem = f"'{channel.name}' has its distribution from scenario_parameters."
        raise InvalidValue(f"{field}.sigma", problem, "Leave it out.")
    if given and kind is EVENT:
        problem = f"'{channel.name}' is an event, which has no standard deviation."
        raise InvalidValue(f"{field}.sigma", problem, "Set rate and mean_steps of its shape.")
    if channel.ahead_m is not None and channel.name != GHOST:
        problem = f"'{channel.name}' is no ghost."
        raise InvalidValue(f"{field}.ahead_m", problem, "Leave it out.")
    grows = isinstance(channel.shape, Markov) and bool(channel.shape.growth_per_m)
    if grows and split_name(channel.name).quantity != MISSED:
        problem = f"'{channel.name}' is at no vehicle whose distance it could grow with."
        raise InvalidValue(f"{field}.shape.rate_per_m", problem, "Leave it out.")
    if channel.shape is not None and channel.shape.__struct_config__.tag not in kind.shapes:
        problem = f"the noise of '{channel.name}' cannot have this shape."
        raise InvalidValue(f"{field}.shape", problem, f"Take {', '.join(kind.shapes)}.")
