"""Any process as a system under test, simulator and planner in one; docs/bridge.md.

A campaign has `simulator` "bridge"; its `scenario` and `planner` are names that the bridge offers.
A campaign cannot give the address of the bridge: the user who starts a worker gives it.
"""

import os
import re
from collections.abc import Collection, Iterable, Mapping
from math import isfinite
from typing import Annotated, Any, NamedTuple

import msgspec
from msgspec import Meta

from eigenfail.addresses import TRUST_VARIABLE, is_own_endpoint
from eigenfail.errors import InvalidValue, UnknownName
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.channels import CHANNELS_FIELD, EVERY, SCENARIO, split_name
from eigenfail.values.disturbance import DisturbanceModel
from eigenfail.values.requirements import FIELD, Formula
from eigenfail.values.signals import BRIDGE
from eigenfail.values.variation import Variation, read_variation

SIMULATOR = "bridge"
"""What a campaign names as its simulator."""

ADDRESS_VARIABLE = "EIGENFAIL_BRIDGE"
ADDRESS_OPTION = "--bridge"
EPISODE_VARIABLE = "EIGENFAIL_EPISODE_LIMIT_S"
EPISODE_OPTION = "--episode-limit"
ADDRESS = re.compile(r"tcp://(\[[0-9a-fA-F:.]+\]|[\w.-]+):[1-9]\d{0,4}|ipc:///?[^\s\0]{1,100}")

LONGEST_TEXT = 200
MOST_PARAMETERS = 64

MAX_OFFER_BYTES = 256 * 1024
"""Longest offer of a bridge, as JSON, that workers report and services keep."""

# What JSON, MessagePack and other languages all have: bridges need not be written in Python.
Plain = bool | int | float | str
Name = Annotated[str, Meta(min_length=1, max_length=LONGEST_TEXT)]
Steps = Annotated[int, Meta(ge=1, le=10_000)]
StepTime = Annotated[float, Meta(gt=0.0, le=10.0)]

POSITION_NOISE = DisturbanceModel()
"""Noise on the position of the nearest vehicle, which chooses no parameter."""

OWN = ("steps", "dt_s")
"""Of `scenario_parameters`, those that eigenfail reads itself; all others are the bridge's."""


class BridgeCheck(msgspec.Struct, frozen=True, tag=True):
    """Question to a process that can talk to bridges: does this bridge follow the protocol?

    Attributes:
        address: address of the bridge, checked.
        campaign: campaign to run one episode of on the bridge; None runs no episode.
    """

    address: str
    campaign: CampaignSpec | None = None


class GoldenMessages(msgspec.Struct, frozen=True, tag=True):
    """Question to the same process: list the protocol's messages, byte for byte."""


class OfferQuestion(msgspec.Struct, frozen=True, tag=True):
    """Question to the same process: what does this bridge offer? Null if no bridge answers.

    Attributes:
        address: address of the bridge, checked.
    """

    address: str


BridgeQuestion = BridgeCheck | GoldenMessages | OfferQuestion


class OfferedScenario(msgspec.Struct, frozen=True):
    """Scenario that a bridge offers, with the names of its parameters."""

    name: Name
    dt_s: StepTime
    steps: Steps
    parameters: tuple[Name, ...] = ()


class OfferedPlanner(msgspec.Struct, frozen=True):
    """Planner that a bridge offers, with the names of its settings."""

    name: Name
    settings: tuple[Name, ...] = ()


class BridgeOffer(msgspec.Struct, frozen=True):
    """The offer of a bridge to campaigns.

    Attributes:
        name: name of the bridge.
        version: version of the bridge.
        channels: names of the channels that it can disturb; the prefix `every.` means each vehicle.
        signals: names of the signals that it reports at each step.
    """

    name: Name
    version: Name
    scenarios: tuple[OfferedScenario, ...]
    planners: tuple[OfferedPlanner, ...]
    channels: tuple[Name, ...] = ()
    signals: tuple[Name, ...] = ()


class EpisodeDemand(NamedTuple):
    """The needs of an episode on a bridge.

    Attributes:
        parameters: parameters of the scenario, except the two that eigenfail reads itself.
        settings: settings of the planner.
        steps: horizon.
        dt_s: duration of a step according to the campaign.
    """

    scenario: str
    planner: str
    parameters: Mapping[str, Plain]
    settings: Mapping[str, Plain]
    steps: int
    dt_s: float


def check_address(address: str) -> str:
    """Return the address if a worker may connect to it.

    Raises:
        InvalidValue: not a valid address, or on another machine and the network is not declared
            trusted.
    """
    if not ADDRESS.fullmatch(address):
        problem = f"'{address}' is not a valid bridge address."
        remedy = "Write it as tcp://127.0.0.1:PORT or ipc://PATH."
        raise InvalidValue(ADDRESS_OPTION, problem, remedy)
    if not is_own_endpoint(address) and os.environ.get(TRUST_VARIABLE) != "1":
        raise InvalidValue(
            ADDRESS_OPTION,
            f"'{address}' is on another machine, and bridges do not support authentication.",
            f"Run the bridge beside the worker. On a private network, {TRUST_VARIABLE}=1 does "
            "without keys and encryption.",
        )
    return address


def check(spec: CampaignSpec) -> Variation:
    """Check the scenario parameters of a campaign on a bridge, and return them.

    The bridge itself accepts or refuses the names later.

    Raises:
        InvalidValue: the horizon is missing, a value is not a number, truth value or text, or there
            are too many.
    """
    # The bridge may be away while a campaign is checked: all that can be said without it is said
    # now.
    read_plain(spec.planner_settings, "planner_settings")
    return variation(spec.scenario_parameters, model=spec.disturbance)


def variation(
    given: Mapping[str, Any],
    field: str = "scenario_parameters",
    model: DisturbanceModel = POSITION_NOISE,
) -> Variation:
    """Return scenario parameters as a user gave them: each fixed, drawn, or chosen by a search.

    Args:
        given: value or distribution of each parameter, by name.
        field: field that the parameters were given in, for the error.
        model: disturbance model, whose channels name the parameters that a search chooses.

    Raises:
        InvalidValue: as `check` does.
    """
    if "steps" not in given:
        remedy = "Give the horizon of the scenario, as `eigenfail doctor --bridge ADDRESS` shows."
        raise InvalidValue(f"{field}.steps", "is missing.", remedy)
    refuse_excess_parameters(given, field)
    kind, searched = parameters_kind(given), model.searched_parameters
    found = read_variation(kind, given, field, searched, model.parameter_correlations)
    for corner in found.corners():
        read_plain(msgspec.structs.asdict(corner), field)
    return found


def parameters_kind(given: Mapping[str, Any]) -> type[msgspec.Struct]:
    """Return a struct type for the given parameters: the two that eigenfail reads, and any others.

    Raises:
        InvalidValue: a name that a parameter cannot have.
    """
    others = [str(name) for name in given if name not in OWN]
    for name in others:
        # Parameters become fields of a struct.
        if not name.isidentifier():
            problem = "is not a valid parameter name."
            raise InvalidValue(f"scenario_parameters.{name}", problem, "Use letters, digits and _.")
    return msgspec.defstruct(
        "BridgeParameters",
        # `steps` has no default, and fields without one stand before those with one.
        [("steps", Steps), *((name, Plain) for name in others), ("dt_s", StepTime, 0.1)],
        frozen=True,
        forbid_unknown_fields=True,
    )


def select_bridge_parameters(parameters: msgspec.Struct) -> dict[str, Plain]:
    """Return the parameters of an episode that the bridge receives under their names."""
    named = msgspec.structs.asdict(parameters)
    return {name: value for name, value in named.items() if name not in OWN}


def read_plain(given: Mapping[str, Any], field: str) -> dict[str, Plain]:
    """Return the values, if every bridge can receive them.

    Raises:
        InvalidValue: one is not a finite number, truth value or short text, or there are too many.
    """
    refuse_excess_parameters(given, field)
    for name, value in given.items():
        fits = {str: lambda text: len(text) <= LONGEST_TEXT, float: isfinite}
        # By the exact type: a subclass, as of numpy's floats, may be encoded as anything.
        if type(value) not in Plain.__args__ or not fits.get(type(value), lambda _: True)(value):
            problem = "is not a finite number, a Boolean or a short string."
            raise InvalidValue(f"{field}.{name}", problem, "A bridge receives no other parameters.")
    return dict(given)


def refuse_excess_parameters(given: Mapping[str, Any], field: str) -> None:
    """Raise InvalidValue for more parameters than a bridge can receive."""
    if len(given) > MOST_PARAMETERS:
        problem = f"there are {len(given)}."
        raise InvalidValue(field, problem, f"A bridge receives at most {MOST_PARAMETERS}.")


def check_offer(offer: BridgeOffer, spec: CampaignSpec) -> None:
    """Check that a bridge offers what the episodes of a campaign need.

    Raises:
        UnknownName: the bridge does not know the scenario, the planner, a parameter, a setting, a
            channel or a signal; the known names are listed.
        InvalidValue: the scenario has fewer steps, or steps of another duration.
    """
    settings = read_plain(spec.planner_settings, "planner_settings")
    for corner in check(spec).corners():
        parameters, steps, dt_s = select_bridge_parameters(corner), corner.steps, corner.dt_s
        demand = EpisodeDemand(spec.scenario, spec.planner, parameters, settings, steps, dt_s)
        check_demand(offer, demand)
    names = (channel.name for channel in spec.disturbance.list_channels())
    check_channels(offer, [name for name in names if split_name(name).target != SCENARIO])
    for field, signals in find_named_signals(spec).items():
        check_signals(offer, signals, field)


def check_demand(offer: BridgeOffer, demand: EpisodeDemand) -> None:
    """Check that a bridge offers what an episode needs.

    Raises:
        UnknownName: the bridge does not know the scenario, the planner, a parameter or a setting.
        InvalidValue: the scenario has fewer steps, or steps of another duration.
    """
    scenario = find_scenario(offer, demand.scenario)
    planners = {each.name: each.settings for each in offer.planners}
    if demand.planner not in planners:
        raise _make_unknown(offer, "planner", demand.planner, planners)
    for field, given, known in (
        ("scenario_parameters", demand.parameters, scenario.parameters),
        ("planner_settings", demand.settings, planners[demand.planner]),
    ):
        for name in given:
            if name not in known:
                raise _make_unknown(offer, field, name, known)
    named = f"'{scenario.name}' of {_describe_bridge(offer)}"
    if demand.steps > scenario.steps:
        problem = f"{named} has no more than {scenario.steps} steps."
        raise InvalidValue("scenario_parameters.steps", problem, "Ask for no more.")
    # No tolerance: with another step, the noise of a step would last for another time.
    if demand.dt_s != scenario.dt_s:
        asked_s, dt_s = demand.dt_s, scenario.dt_s
        problem = f"a step of {named} takes {dt_s:g} s, and not {asked_s:g} s."
        remedy = f"Write dt_s = {dt_s:g}."
        raise InvalidValue("scenario_parameters.dt_s", problem, remedy)


def find_scenario(offer: BridgeOffer, name: str) -> OfferedScenario:
    """Return the scenario of a bridge by its name.

    Raises:
        UnknownName: the bridge does not offer that scenario.
    """
    for scenario in offer.scenarios:
        if scenario.name == name:
            return scenario
    raise _make_unknown(offer, "scenario", name, (each.name for each in offer.scenarios))


def _describe_bridge(offer: BridgeOffer) -> str:
    return f"the bridge '{offer.name}' (version {offer.version})"


def _make_unknown(offer: BridgeOffer, field: str, name: str, known: Iterable[str]) -> UnknownName:
    problem = f"'{name}' is not known to {_describe_bridge(offer)}."
    return UnknownName(field, name, known, problem)


def check_channels(offer: BridgeOffer, names: Collection[str]) -> None:
    """Check that a bridge can disturb the named channels.

    Raises:
        UnknownName: it cannot disturb one of them.
    """
    for name in names:
        channel = split_name(name)
        # `every.speed` of an offer stands for `vehicle_3.speed`, too.
        is_numbered = channel.vehicle is not None
        if name not in offer.channels and not (
            is_numbered and f"{EVERY}.{channel.quantity}" in offer.channels
        ):
            raise _make_unknown(offer, CHANNELS_FIELD, name, offer.channels)


_SIGNAL = re.compile(rf"\b{BRIDGE}\.[A-Za-z_0-9]+")


def find_named_signals(spec: CampaignSpec) -> dict[str, set[str]]:
    """Return the signals of a bridge that the formulas of a campaign name, by field."""
    judged = {f"{FIELD}[{n}]": each for n, each in enumerate(spec.all_requirements)}
    return {
        field: {*_SIGNAL.findall(each.formula)}
        for field, each in (*judged.items(), ("importance", spec.importance))
        if isinstance(each, Formula)
    }


def check_signals(offer: BridgeOffer, names: Collection[str], field: str = "requirements") -> None:
    """Check that a bridge reports all signals whose names begin with `bridge.`.

    Args:
        offer: what the bridge offers.
        names: names of signals, as in formulas; names with another prefix are ignored.
        field: field of the campaign that names them, for the error.

    Raises:
        UnknownName: it does not report one of them.
    """
    offered = {f"{BRIDGE}.{name}" for name in offer.signals}
    for name in sorted(names):
        if name.startswith(f"{BRIDGE}.") and name not in offered:
            raise _make_unknown(offer, field, name, offered)
