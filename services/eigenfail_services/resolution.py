"""Resolved campaigns: the method with its settings, and the references in the settings.

Nothing heavy is loaded for it: neither the database nor what methods train with.
"""

from collections.abc import Mapping
from contextlib import suppress
from typing import Any

import msgspec

from eigenfail.contracts import MethodTraits, Reference
from eigenfail.errors import InvalidValue
from eigenfail.methods import UNDECLARED, MethodDescription, describe_method
from eigenfail.settings import convert
from eigenfail.values.campaign import EpisodeForm
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.proof import ReplayKind


class ResolvedMethod(msgspec.Struct, frozen=True):
    """A method and its settings.

    Attributes:
        description: description of the method.
        settings: an instance of the method's `Settings`.
        given: the settings as the user gave them, without defaults.
        field: path of the settings in the spec.
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


def resolve_method(name: str, given: Mapping[str, Any], field: str = "settings") -> ResolvedMethod:
    """Load a method and read its settings.

    Raises:
        UnknownName: the method, or one of its settings, does not exist.
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


class NamedNoise(msgspec.Struct, frozen=True, omit_defaults=True):
    """Noise of earlier episodes that is injected again, under the names of the settings.

    Attributes:
        analysis: id of the analysis whose modes are meant; it counts before the campaign.
        mode: number of a mode, counted from 1; None if `modes` says which.
        modes: numbers of modes, counted from 1; all of them if it is empty.
        what: kinds of noise that represent a mode.
        campaign: id of the campaign whose episodes are meant.
        episode: index of an episode; None if `episodes` says which.
        episodes: indices of episodes; all failures if it is empty.
    """

    analysis: int | None = None
    mode: int | None = None
    modes: tuple[int, ...] = ()
    what: tuple[ReplayKind, ...] = (ReplayKind.EIGENFAILURE,)
    campaign: int | None = None
    episode: int | None = None
    episodes: tuple[int, ...] = ()

    @property
    def indices(self) -> tuple[int, ...]:
        """The indices of the episodes that are named one by one."""
        return self.episodes if self.episode is None else (self.episode,)


class CampaignReferences(msgspec.Struct, frozen=True, omit_defaults=True):
    """The earlier campaigns, and their noise, to which the settings of a campaign refer.

    Attributes:
        noise: noise of earlier episodes that is injected again.
        learners: campaigns whose learners are used or continued, by the path of the setting.
        data: campaigns whose episodes are learnt from, by the path of the setting.
    """

    noise: NamedNoise = NamedNoise()
    learners: dict[str, int] = {}
    data: dict[str, tuple[int, ...]] = {}

    @property
    def noise_sources(self) -> frozenset[int]:
        """The campaigns whose noise is injected or learnt from."""
        injected = () if self.noise.campaign is None else (self.noise.campaign,)
        return frozenset(injected).union(*self.data.values())


DETAILS = {"analysis": ("mode", "modes", "what"), "campaign": ("episode", "episodes")}
"""Settings that say which noise is meant, by the setting that names where it is."""


def find_references(method: ResolvedMethod) -> CampaignReferences:
    """Return the references to earlier campaigns in a method's settings.

    A method that declares no references may give these settings another meaning. Then defaults and
    values of another type do not count as references.

    Raises:
        InvalidValue: a setting is not the kind of reference that the method declares, or the method
            declares a noise reference under a name that is not in `DETAILS`.
    """
    declared = method.traits.references is not UNDECLARED.references
    known = msgspec.to_builtins(method.settings if declared else method.given)
    tolerated = () if declared else (InvalidValue,)
    noise, learners, data = NamedNoise(), {}, {}
    for name, kind in method.traits.references.items():
        value, field = known.get(name), f"{method.field}.{name}"
        if kind is Reference.NOISE and name not in DETAILS:
            problem = f"{method.name} declares that '{name}' names noise, which no such name can."
            raise InvalidValue("method", problem, f"Call it {' or '.join(DETAILS)} there.")
        if value in (None, (), []):
            continue
        with suppress(*tolerated):
            if kind is Reference.NOISE:
                named = {each: known[each] for each in (name, *DETAILS[name]) if each in known}
                noise = convert(msgspec.to_builtins(noise) | named, NamedNoise, method.field)
            elif kind is Reference.EPISODES:
                data[field] = convert(value, tuple[int, ...], field)
            else:
                learners[field] = convert(value, int, field)
    return CampaignReferences(noise, learners, data)


class CheckedCampaign(msgspec.Struct, frozen=True):
    """A campaign with the findings of its check, which are stored with it.

    Attributes:
        spec: its spec.
        form: length and channels of its episodes.
        references: the references to earlier campaigns in its settings.
    """

    spec: CampaignSpec
    form: EpisodeForm
    references: CampaignReferences


class ResolvedCampaign(CheckedCampaign, frozen=True):
    """A campaign whose plug-ins are loaded and whose settings are read.

    Attributes:
        method: method that the spec names.
        searching: the method that proposes noise: an ensemble's member method, else `method`.
    """

    method: ResolvedMethod
    searching: ResolvedMethod
