"""Campaigns with the plug-ins that their specs name, and the settings of these."""

import contextlib
from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import msgspec
from msgspec.structs import replace

from eigenfail.contracts import MethodTraits, Reference
from eigenfail.errors import EigenfailError, InvalidValue
from eigenfail.methods import MethodDescription, describe_method
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.variation import KINDS
from eigenfail.worlds import CampaignWorld, world_of
from eigenfail_services.methods import explain_no_estimate

MOST_SPECS = 2_000
"""Specs whose defaults are kept. A page of releases reads as many campaigns, most of them alike."""


class ResolvedMethod(msgspec.Struct, frozen=True):
    """A method and its settings.

    Attributes:
        description: description of the method.
        settings: read; an instance of the method's `Settings`.
        given: the settings as the user gave them.
        field: where these stand in the spec.
    """

    description: MethodDescription
    settings: Any
    given: Mapping[str, Any]
    field: str

    @property
    def name(self) -> str:
        """Return the name of the method."""
        return self.description.name

    @property
    def traits(self) -> MethodTraits:
        """Return the traits that the method declares."""
        return self.description.traits

    def given_references(self, *kinds: Reference) -> dict[str, Any]:
        """Return the settings that name something to take these from, with what they name."""
        return {
            name: self.given[name]
            for name, kind in self.traits.references.items()
            if kind in kinds and self.given.get(name) is not None
        }


class ResolvedCampaign(msgspec.Struct, frozen=True):
    """A campaign whose plug-ins are loaded and whose settings are read.

    Attributes:
        spec: as the user gave it.
        world: world in which it runs.
        horizon: steps of a full episode.
        channels: names of the channels of its noise, in the order of the columns of z.
        method: method that the spec names.
        searching: the method that proposes noise: that of an ensemble's members, else `method`.
    """

    spec: CampaignSpec
    world: CampaignWorld
    horizon: int
    channels: tuple[str, ...]
    method: ResolvedMethod
    searching: ResolvedMethod


def resolve_campaign(spec: CampaignSpec) -> ResolvedCampaign:
    """Load the method and the scenario of a campaign, and read their settings.

    Raises:
        UnknownName: a plug-in, setting, parameter or distribution that does not exist.
        InvalidValue: a value outside its bounds.
    """
    method = resolve_method(spec.method, spec.settings)
    return make_resolved_campaign(spec, method, find_searching(method))


def make_resolved_campaign(
    spec: CampaignSpec, method: ResolvedMethod, searching: ResolvedMethod
) -> ResolvedCampaign:
    """Return a campaign with its methods and what its world says of its episodes.

    Raises:
        UnknownName: a plug-in, parameter or distribution that does not exist.
        InvalidValue: a parameter outside its bounds.
    """
    world = world_of(spec.simulator)
    horizon, channels = world.horizon(spec), world.channels(spec)
    return ResolvedCampaign(spec, world, horizon, channels, method, searching)


def resolve_method(name: str, given: Mapping[str, Any], field: str = "settings") -> ResolvedMethod:
    """Load a method and read its settings.

    Raises:
        UnknownName: no such method, or it has no such setting.
        InvalidValue: a setting outside its bounds.
    """
    description = describe_method(name)
    return ResolvedMethod(description, description.read_settings(given, field), given, field)


def find_searching(method: ResolvedMethod) -> ResolvedMethod:
    """Return the method of an ensemble's members, or the method itself."""
    # An ensemble only shares out the episodes: what noise means is up to its members.
    if not method.traits.has_members:
        return method
    members = method.settings
    return resolve_method(members.method, members.settings, f"{method.field}.settings")


def fill_defaults(spec: CampaignSpec) -> CampaignSpec:
    """Return the spec with the defaults of its method, planner and scenario written out.

    Two specs that differ only in which defaults they write out become equal. A plug-in that is not
    installed here, or that has changed since and refuses the settings, leaves its part unchanged.
    """
    return _fill_written(msgspec.json.encode(spec, order="deterministic"))


# Reading the settings types of plug-ins takes most of the time of a comparison, and campaigns that
# are compared are mostly written alike: so specs are kept by their text.
@lru_cache(maxsize=MOST_SPECS)
def _fill_written(written: bytes) -> CampaignSpec:
    spec = msgspec.json.decode(written, type=CampaignSpec)
    world = world_of(spec.simulator)
    for fill in (_fill_method, world.fill_planner, world.fill_scenario):
        with contextlib.suppress(EigenfailError):
            spec = fill(spec)
    return spec


def _fill_method(spec: CampaignSpec) -> CampaignSpec:
    settings = resolve_method(spec.method, spec.settings).settings
    return replace(spec, settings=msgspec.to_builtins(settings))


def check_estimates(method: ResolvedMethod, field: str, *, of_exploits: bool = False) -> None:
    """Make sure that a method estimates a probability under its settings.

    Args:
        method: method with its settings.
        field: what asks for the probability.
        of_exploits: the probability is to come from what the method proposes without learning on.

    Raises:
        InvalidValue: it makes no estimate.
    """
    known = method.description
    if not (known.weighs if of_exploits else known.estimates):
        problem = f"{method.name} estimates no probability."
        raise InvalidValue(field, problem, "Leave this rule out, or take a method that does.")
    if why := explain_no_estimate(method.settings):
        problem = f"{method.name} estimates no probability here: {why}"
        raise InvalidValue(field, problem, "Or leave this rule out.")


def list_varied(spec: CampaignSpec) -> tuple[str, ...]:
    """Return the scenario parameters that have a distribution."""
    given = spec.scenario_parameters.items()
    return tuple(name for name, value in given if is_distribution(value))


def list_drawn(spec: CampaignSpec) -> tuple[str, ...]:
    """Return the scenario parameters that each episode draws from its seed, not by its noise."""
    searched = spec.disturbance.searched_parameters
    return tuple(name for name in list_varied(spec) if name not in searched)


def is_distribution(value: Any) -> bool:
    """Return whether a scenario parameter is drawn for each episode."""
    return isinstance(value, dict) and not KINDS.keys().isdisjoint(value)
