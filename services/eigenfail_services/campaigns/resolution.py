"""Campaigns with everything found that their specs name: plug-ins, settings, earlier campaigns.

A spec is resolved once; with a `ResolvedCampaign` nothing is loaded or read again.
"""

import contextlib
from collections.abc import Callable, Mapping, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any

import msgspec
from msgspec.structs import replace

from eigenfail import values
from eigenfail.contracts import MethodTraits, Reference
from eigenfail.errors import EigenfailError, InvalidValue, NotFound, ProtocolError
from eigenfail.methods import MethodDescription, describe_method, traits_of
from eigenfail.worlds import CampaignWorld, list_channels, world_of
from eigenfail_services.campaigns.rounds import read_checkpoint
from eigenfail_services.methods import explain_no_estimate

if TYPE_CHECKING:  # a spec is checked without SQLAlchemy, which takes its time to load
    from eigenfail_services.store import Store

MOST_SPECS = 2_000
"""Specs whose defaults are kept. A page of releases reads as many campaigns, most of them alike."""

MOST_READ = 100_000
"""Episodes that are looked through as data, of all campaigns together."""

AT_BIRTH = frozenset({Reference.OWN_LEARNER, Reference.EPISODES})
"""What came of these is in a learner's state, so that a learner that is restored needs them not."""


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
        """The name of the method."""
        return self.description.name

    @property
    def traits(self) -> MethodTraits:
        """What the method declares of itself."""
        return self.description.traits

    def given_references(self, *kinds: Reference) -> dict[str, Any]:
        """Return the settings that name something to take these from, with what they name."""
        return {
            name: self.given[name]
            for name, kind in self.traits.references.items()
            if kind in kinds and self.given.get(name) is not None
        }


class References(msgspec.Struct, frozen=True):
    """Earlier campaigns that a campaign builds on.

    Attributes:
        predecessors: learners of earlier campaigns; one at most.
        data: campaigns whose episodes are learnt from, by id.
    """

    predecessors: tuple[values.Predecessor, ...] = ()
    data: tuple[values.Campaign, ...] = ()


class ResolvedCampaign(msgspec.Struct, frozen=True):
    """A campaign whose plug-ins are loaded and whose settings are read.

    Attributes:
        spec: as the user gave it.
        world: world in which it runs.
        horizon: steps of a full episode.
        channels: names of the channels of its noise, in the order of the columns of z.
        method: method that the spec names.
        searching: the method that proposes noise: that of an ensemble's members, else `method`.
        references: what it builds on; none before `find_references`.
    """

    spec: values.CampaignSpec
    world: CampaignWorld
    horizon: int
    channels: tuple[str, ...]
    method: ResolvedMethod
    searching: ResolvedMethod
    references: References = References()


def resolve_campaign(spec: values.CampaignSpec) -> ResolvedCampaign:
    """Load the method and the scenario of a campaign, and read their settings.

    Raises:
        UnknownName: a plug-in, setting, parameter or distribution that does not exist.
        InvalidValue: a value outside its bounds.
    """
    method = resolve_method(spec.method, spec.settings)
    return make_resolved_campaign(spec, method, find_searching(method))


def make_resolved_campaign(
    spec: values.CampaignSpec, method: ResolvedMethod, searching: ResolvedMethod
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
    if not method.traits.has_members:
        return method
    members = method.settings
    return resolve_method(members.method, members.settings, f"{method.field}.settings")


def fill_defaults(spec: values.CampaignSpec) -> values.CampaignSpec:
    """Return the spec with the defaults of its method, planner and scenario written out.

    Two specs that differ only in which defaults they write out become equal. A plug-in that is not
    installed here, or that has changed since and refuses the settings, leaves its part unchanged.
    """
    return _fill_written(msgspec.json.encode(spec, order="deterministic"))


# Reading the settings types of plug-ins takes most of the time of a comparison, and campaigns that
# are compared are mostly written alike: so specs are kept by their text.
@lru_cache(maxsize=MOST_SPECS)
def _fill_written(written: bytes) -> values.CampaignSpec:
    spec = msgspec.json.decode(written, type=values.CampaignSpec)
    world = world_of(spec.simulator)
    for fill in (_fill_method, world.fill_planner, world.fill_scenario):
        with contextlib.suppress(EigenfailError):
            spec = fill(spec)
    return spec


def _fill_method(spec: values.CampaignSpec) -> values.CampaignSpec:
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


def find_references(campaign: ResolvedCampaign, store: "Store") -> ResolvedCampaign:
    """Return the campaign with the earlier campaigns that its settings build on.

    Raises:
        InvalidValue: one does not exist, has not ended, has learnt nothing, or its episodes are of
            another length, have another number of channels of noise, or are pruned.
    """
    found = References(_find_predecessors(campaign, store), _find_data(campaign, store))
    return replace(campaign, references=found)


def check_channels(before: values.Campaign, field: str, channels: Sequence[str]) -> None:
    """Make sure that the noise of an earlier campaign has the same channels as here.

    Those of functions may have other names.

    Raises:
        InvalidValue: it has others, or in another order.
    """
    there = list_channels(before.spec)
    if len(there) != len(channels):
        problem = (
            f"the noise of campaign {before.id} has another number of channels: {len(there)} "
            f"there, {len(channels)} here."
        )
        raise InvalidValue(field, problem, "Name one whose noise has as many channels.")
    if there != tuple(channels) and world_of(before.spec.simulator).has_road:
        problem = (
            f"the noise of campaign {before.id} has other channels: {', '.join(there)} there, "
            f"{', '.join(channels)} here."
        )
        raise InvalidValue(field, problem, "Name one with the same channels in the same order.")


def _find_predecessors(
    campaign: ResolvedCampaign, store: "Store"
) -> tuple[values.Predecessor, ...]:
    searching = campaign.searching
    named = searching.given_references(Reference.LEARNER, Reference.OWN_LEARNER)
    for name, number in named.items():
        field = f"{searching.field}.{name}"
        before = find_ended(number, field, store)
        check_channels(before, field, campaign.channels)
        if searching.traits.references[name] is Reference.OWN_LEARNER:
            _check_same_method(before, searching.name, field)
        else:
            check_has_knowledge(before, field)
            if campaign.spec.stop.cv is not None and searching is campaign.method:
                own = resolve_method(before.spec.method, before.spec.settings)
                check_estimates(own, "stop.cv", of_exploits=True)
        return (_read_predecessor(before, field, store),)
    return ()


def find_ended(campaign: int, field: str, store: "Store") -> values.Campaign:
    """Return an earlier campaign that a setting names.

    Raises:
        InvalidValue: it does not exist, or has not ended.
    """
    # A campaign that goes on would make a later one depend on the clock.
    try:
        before = store.campaigns.get(campaign)
    except NotFound as error:
        raise InvalidValue(field, error.problem, error.remedy) from error
    if before.state not in values.FINAL_STATES:
        problem = f"campaign {campaign} is {before.state} and has not ended."
        remedy = f"Wait for its end (`eigenfail campaign watch {campaign}`), or cancel it."
        raise InvalidValue(field, problem, remedy)
    return before


def check_has_knowledge(before: values.Campaign, field: str) -> None:
    """Make sure that a campaign's method has knowledge to be used.

    Raises:
        UnknownName: the method is not installed here.
        InvalidValue: it has none.
    """
    spec = before.spec
    method = describe_method(spec.method)
    if method.traits.has_members:
        members = method.read_settings(spec.settings, "settings")
        method = describe_method(members.method)
    if not method.exploits:
        problem = (
            f"campaign {before.id} is one of {method.name}, which learns nothing that could be"
            " used."
        )
        raise InvalidValue(field, problem, "Name a campaign of a method that learns, such as ast.")


def _check_same_method(before: values.Campaign, method: str, field: str) -> None:
    if before.spec.method != method:
        problem = (
            f"campaign {before.id} is one of {before.spec.method} and has no policy of {method}."
        )
        raise InvalidValue(field, problem, f"Name a campaign of {method}.")


def _read_predecessor(before: values.Campaign, field: str, store: "Store") -> values.Predecessor:
    spec = before.spec
    return values.Predecessor(
        campaign=before.id,
        method=spec.method,
        settings=leave_out_births(spec.method, spec.settings),
        seed=values.learner_seed(spec.seed),
        episodes=spec.episodes,
        horizon=world_of(spec.simulator).horizon(spec),
        state=_read_last_state(before, field, store),
    )


def _read_last_state(before: values.Campaign, field: str, store: "Store") -> bytes:
    try:
        checkpoint = store.checkpoints.load(before.id)
        if checkpoint is not None:
            return read_checkpoint(checkpoint).learner
    except ProtocolError as error:
        raise InvalidValue(field, f"campaign {before.id}: {error.problem}", error.remedy) from error
    problem = f"campaign {before.id} ended before its first round and has no checkpoint."
    raise InvalidValue(field, problem, "Launch a copy of it, and use its id.")


def leave_out_births(method: str, settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return the settings without those that matter at a learner's birth alone."""
    traits = traits_of(method)
    kept = {
        name: value
        for name, value in settings.items()
        if traits.references.get(name) not in AT_BIRTH
    }
    if traits.has_members and "settings" in kept:
        kept["settings"] = leave_out_births(kept.get("method", ""), kept["settings"])
    return kept


def _find_data(campaign: ResolvedCampaign, store: "Store") -> tuple[values.Campaign, ...]:
    searching = campaign.searching
    for name, numbers in searching.given_references(Reference.EPISODES).items():
        field = f"{searching.field}.{name}"
        named = tuple(find_ended(number, field, store) for number in sorted(set(numbers)))
        for before in named:
            _check_data(before, field, campaign.horizon)
            _check_question(before, field, campaign.spec)
            check_channels(before, field, campaign.channels)
            _refuse_pruned(before, field, store)
        if (count := sum(before.counts.completed for before in named)) > MOST_READ:
            problem = (
                f"{count:,} episodes are more than the {MOST_READ:,} that can be looked through."
            )
            raise InvalidValue(field, problem, "Name fewer or smaller campaigns.")
        return named
    return ()


def _check_data(before: values.Campaign, field: str, steps: int) -> None:
    if not before.counts.completed:
        problem = f"campaign {before.id} has not completed a single episode."
        raise InvalidValue(field, problem, "Name one that has.")
    check_horizon(before, field, steps)


def _check_question(before: values.Campaign, field: str, spec: values.CampaignSpec) -> None:
    """Make sure that robustness means the same in an earlier campaign as here.

    Raises:
        InvalidValue: its requirements, or its importance, are others.
    """
    asked, here = ((each.all_requirements, each.importance) for each in (before.spec, spec))
    if asked != here:
        problem = f"campaign {before.id} has other requirements, or another importance."
        raise InvalidValue(field, problem, "Name campaigns that have the same.")


def check_horizon(before: values.Campaign, field: str, steps: int) -> None:
    """Make sure that the episodes of an earlier campaign have as many steps as here.

    Raises:
        InvalidValue: they have not.
    """
    there = world_of(before.spec.simulator).horizon(before.spec)
    if there != steps:
        problem = (
            f"the episodes of campaign {before.id} have {there} steps, here they have {steps}."
        )
        raise InvalidValue(field, problem, "Name campaigns in scenarios of as many steps.")


def _refuse_pruned(before: values.Campaign, field: str, store: "Store") -> None:
    # What pruning has left is another sample than the campaign's episodes.
    if records := store.retention.of(before.id):
        lost = sum(each.weight.episodes for each in records)
        problem = f"the noise of {lost:,} episodes of campaign {before.id} was pruned."
        raise InvalidValue(field, problem, "Name another, or restore a backup from before.")


def read_trajectories(method: ResolvedMethod, store: "Store") -> Sequence[values.Floats]:
    """Return the noise trajectories that a method's settings name; none if they name none.

    Raises:
        InvalidValue: an analysis is not done, or has no such mode.
        NotFound: there is no such analysis or episode.
    """
    named = method.given_references(Reference.NOISE)
    # A method may replay other kinds than `replay` where nothing is given.
    what = getattr(method.settings, "what", None)
    given = method.given if what is None else {**method.given, "what": what}
    for name, read in READERS.items():
        if name in named:
            return read(given, store)
    return ()


def _read_analysed(settings: Mapping[str, Any], store: "Store") -> Sequence[values.Floats]:
    analysis = store.analyses.get(settings["analysis"])
    modes = _choose_modes(analysis, settings)
    kinds = settings.get("what") or (values.ReplayKind.EIGENFAILURE,)
    return [
        noise for kind in kinds for noise in KINDS[values.ReplayKind(kind)](analysis, modes, store)
    ]


def _choose_modes(
    analysis: values.Analysis, settings: Mapping[str, Any]
) -> Sequence[values.FailureMode]:
    if analysis.result is None:
        problem = f"analysis {analysis.id} is {analysis.state} and has no eigenfailures."
        raise InvalidValue("settings.analysis", problem, "Wait for it, or launch another.")
    modes = analysis.result.modes
    field = "mode" if settings.get("mode") is not None else "modes"
    numbers = (settings["mode"],) if field == "mode" else settings.get("modes", ())
    for number in numbers:
        if number > len(modes):
            problem = f"analysis {analysis.id} has {len(modes)} modes, and none of number {number}."
            raise InvalidValue(f"settings.{field}", problem, "They are counted from 1.")
    return [modes[number - 1] for number in numbers] if numbers else modes


def _read_medoids(
    analysis: values.Analysis, modes: Sequence[values.FailureMode], store: "Store"
) -> list[values.Floats]:
    places = ((mode.medoid_campaign or analysis.campaign, mode.medoid) for mode in modes)
    return [store.episodes.get(*place).noise.z for place in places]


KINDS: dict[
    values.ReplayKind,
    Callable[[values.Analysis, Sequence[values.FailureMode], "Store"], list[values.Floats]],
] = {
    values.ReplayKind.EIGENFAILURE: lambda _a, modes, _s: [mode.eigenfailure for mode in modes],
    values.ReplayKind.MEDOID: _read_medoids,
}


def _read_recorded(settings: Mapping[str, Any], store: "Store") -> Sequence[values.Floats]:
    """Of episodes of another campaign: those listed, or all of its failures."""
    campaign, episode = settings["campaign"], settings.get("episode")
    episodes = settings.get("episodes") if episode is None else (episode,)
    if not episodes:
        return store.episodes.failures(campaign).noise
    return [store.episodes.get(campaign, index).noise.z for index in episodes]


READERS: Mapping[str, Callable[[Mapping[str, Any], "Store"], Sequence[values.Floats]]] = {
    "analysis": _read_analysed,
    "campaign": _read_recorded,
}
"""How the noise is read that the settings of these names refer to; the first one given counts."""
