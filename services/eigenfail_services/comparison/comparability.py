"""Comparability of campaigns: whether their questions and their noise are the same."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from math import lcm
from typing import Any, NamedTuple

import msgspec
import numpy as np
from msgspec.structs import replace

from eigenfail.contracts import Injection
from eigenfail.methods import traits_of
from eigenfail.suites import KeyPath, list_leaves
from eigenfail.values.campaign import Campaign
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.comparison import Distinction, PairTotals
from eigenfail.values.episode import EpisodeResult
from eigenfail.worlds import list_channels
from eigenfail_services.campaigns.validation import fill_defaults
from eigenfail_services.store.store import Store

Group = tuple[Campaign, ...]

THINGS = {
    "method": "method",
    "settings": "method",
    "parallel": "method",
    "scenario": "scenario",
    "scenario_parameters": "scenario",
    "planner": "planner",
    "planner_settings": "planner",
    "planner_version": "planner",
    "simulator": "simulator",
    "disturbance": "disturbance model",
    "requirements": "requirements",
    "importance": "method",
    "episodes": "budget",
    "stop": "stop rules",
    "price_usd_per_hour": "price",
    "instances": "price",
}
"""The thing that a field of a spec belongs to; other fields change no result."""

RANKS = {field: rank for rank, field in enumerate(THINGS)}
FIELD_RANKS = {field: rank for rank, field in enumerate(CampaignSpec.__struct_fields__)}

OWNERS = {
    "settings": "method",
    "planner_settings": "planner",
    "scenario_parameters": "scenario",
}
"""The field of a spec that names the plug-in to which the settings of another field belong."""

DRAWN = "scenario_parameters"
"""A parameter may have a distribution in place of a value: that is one setting."""

DEFAULT = "default"

NO_VERSION = "not given"
"""The value of `planner_version` in a spec without one: there is no default version."""

NOTHING = "–"
"""The value of a setting that a plug-in does not have, or that is None."""

FlatSpec = Mapping[str, str]
"""The values of a spec as text, by dotted path."""


def group_alike(campaigns: Sequence[Campaign]) -> tuple[Group, ...]:
    """Group campaigns whose settings in `THINGS` are equal, ordered by each group's first campaign.

    The campaigns may differ in their seed and in fields that change no result, such as name,
    project and tags.
    """
    # Defaults are filled in, so that a campaign that writes one out is like one that does not.
    found: dict[bytes, list[Campaign]] = {}
    for campaign in campaigns:
        fields = msgspec.to_builtins(fill_defaults(campaign.spec))
        key = msgspec.json.encode({name: fields.get(name) for name in THINGS}, order="sorted")
        found.setdefault(key, []).append(campaign)
    return tuple(map(tuple, found.values()))


def write_release_question(spec: CampaignSpec) -> str:
    """Return a text that is equal for campaigns that can be releases of the same planner.

    Settings of method and planner may differ: a release changes its planner, and the noise that the
    method draws is compared elsewhere.
    """
    fields = ("method", "planner", "scenario", "scenario_parameters", "simulator", "disturbance")
    # A spec needs a name and a budget, which are no part of the question.
    asked = CampaignSpec(
        **{name: getattr(spec, name) for name in fields},
        name="-",
        episodes=1,
        requirements=spec.all_requirements,
    )
    same = replace(fill_defaults(asked), settings={}, planner_settings={})
    return msgspec.json.encode(same, order="deterministic").decode()


def list_given_settings(spec: CampaignSpec) -> dict[KeyPath, Any]:
    """Return all settings of a campaign but name and priority, by path."""
    table = msgspec.to_builtins(spec)
    del table["name"], table["priority"]
    drawn = table.pop(DRAWN)
    found: dict[KeyPath, Any] = {path: value for path, value in list_leaves(table) if value != {}}
    return found | {(DRAWN, name): value for name, value in drawn.items()}


def list_differing(specs: Sequence[CampaignSpec]) -> list[KeyPath]:
    """Return the paths at which specs differ, in the order of a spec's fields; names aside."""
    # None is a value, too: a setting that is not there needs a mark of its own.
    first, *others = given = [list_given_settings(spec) for spec in specs]
    absent = object()
    differing = [
        path
        for path in dict.fromkeys(path for one in given for path in one)
        if any(one.get(path, absent) != first.get(path, absent) for one in others)
    ]
    return sorted(differing, key=lambda path: FIELD_RANKS[path[0]])


def flatten_spec(spec: CampaignSpec) -> dict[str, str]:
    """Return every value of a spec, defaults included, as text by dotted path."""
    plain = msgspec.to_builtins(fill_defaults(spec))
    # All requirements are one text: paths into a list would compare requirements by their place.
    named = [f"{each.in_words()} (scale {each.scale:g})" for each in spec.all_requirements]
    values = list_leaves(plain | {"requirements": "; ".join(named)})
    return {
        ".".join(path): NOTHING if value is None else str(value)
        for path, value in values
        if value != {}
    }


class SettingValues(msgspec.Struct, frozen=True):
    """The values of one setting in several campaigns, as text.

    Attributes:
        path: path in a CampaignSpec.
        values: values in the order of the campaigns.
    """

    path: str
    values: tuple[str, ...]

    @property
    def differs(self) -> bool:
        """Return whether the campaigns have different values."""
        return len(set(self.values)) > 1


def compare_settings(campaigns: Sequence[Campaign]) -> tuple[SettingValues, ...]:
    """Return all settings of campaigns, with the defaults of installed plug-ins."""
    flat = [flatten_spec(each.spec) for each in campaigns]
    paths = dict.fromkeys(path for each in flat for path in each)
    return tuple(
        SettingValues(path, tuple(each.get(path, NOTHING) for each in flat))
        for path in sorted(paths, key=lambda path: FIELD_RANKS[_name_field(path)])
    )


def find_distinctions(
    a: Sequence[CampaignSpec], b: Sequence[CampaignSpec]
) -> tuple[Distinction, ...]:
    """Return every setting whose values differ between the sides, in the order of `THINGS`.

    Defaults are resolved on both sides, so that writing one out makes no difference. A setting that
    only one side's plug-ins have is listed if a campaign gives it another value than the default.
    The version of the planner counts as a setting: a campaign without a version differs from a
    campaign with one.
    """
    left, right = [*map(flatten_spec, a)], [*map(flatten_spec, b)]
    shared = _list_paths(left) & _list_paths(right)
    of_one_side = (_list_paths(left) ^ _list_paths(right)) & _find_chosen_paths([*a, *b])
    found = []
    for path in _sort_paths(shared | of_one_side):
        one, other = (_find_values(side, path, [*left, *right]) for side in (left, right))
        if one != other:
            found.append(Distinction(path, ", ".join(one), ", ".join(other)))
    return tuple(found)


def find_differing_fields(found: Iterable[Distinction]) -> tuple[str, ...]:
    """Return the things that the distinctions belong to, each once."""
    return tuple(dict.fromkeys(THINGS[_name_field(each.thing)] for each in found))


def find_mixed_fields(specs: Sequence[CampaignSpec]) -> tuple[str, ...]:
    """Return the things that differ among the campaigns of one side."""
    side = [*map(flatten_spec, specs)]
    mixed = (
        THINGS[_name_field(path)]
        for path in _sort_paths(_list_paths(side))
        if len(_find_values(side, path, side)) > 1
    )
    return tuple(dict.fromkeys(mixed))


def _name_field(path: str) -> str:
    return path.partition(".")[0]


def _list_paths(side: Iterable[FlatSpec]) -> set[str]:
    """Return the paths of the settings on which results depend."""
    return {path for spec in side for path in spec if _name_field(path) in THINGS}


def _sort_paths(paths: Iterable[str]) -> list[str]:
    return sorted(paths, key=lambda path: (RANKS[_name_field(path)], path))


def _find_values(
    side: Iterable[FlatSpec], path: str, all_specs: Iterable[FlatSpec]
) -> tuple[str, ...]:
    """Return the different values of a setting over the campaigns of a side."""
    found = {spec.get(path) or _name_absent(path, spec, all_specs) for spec in side}
    return tuple(sorted(found))


def _name_absent(path: str, spec: FlatSpec, all_specs: Iterable[FlatSpec]) -> str:
    """Return the value of a setting that a spec does not have.

    The value is the default only if the plug-in has such a setting, as another campaign with the
    plug-in shows.
    """
    if path == "planner_version":
        return NO_VERSION
    owner = OWNERS.get(_name_field(path))
    alike = (other for other in all_specs if owner is None or other[owner] == spec[owner])
    return DEFAULT if any(path in other for other in alike) else NOTHING


def _find_chosen_paths(specs: Sequence[CampaignSpec]) -> set[str]:
    """Return the settings of plug-ins to which a campaign gives another value than the default."""
    found = set()
    for spec in specs:
        bare = replace(
            spec,
            settings={},
            planner_settings={},
            scenario_parameters={},
            requirements=msgspec.UNSET,
            importance=msgspec.UNSET,
            planner_version=msgspec.UNSET,
        )
        given, default = flatten_spec(spec), flatten_spec(bare)
        found |= {path for path, value in given.items() if default.get(path) != value}
    return found


PAIRS_COMPARED = 32
"""Pairs of episodes of each pair of campaigns that are read to check that their noise is equal."""


class PairedEpisodes(NamedTuple):
    """Pairs of episodes with the same noise, counted, or the reason why there are none."""

    totals: PairTotals | None
    because: str = ""


def pair_episodes(store: Store, a: Sequence[Campaign], b: Sequence[Campaign]) -> PairedEpisodes:
    """Pair episodes of equal index in campaigns of equal seed, if they saw the same noise."""
    if problem := _find_obstacle(a, b):
        return PairedEpisodes(None, problem)
    by_seed = {campaign.spec.seed: campaign for campaign in b}
    matched = [(campaign, by_seed[campaign.spec.seed]) for campaign in a]
    for one, other in matched:
        if problem := _find_other_noise(store, one, other):
            return PairedEpisodes(None, problem)
    totals = [store.episodes.paired(one.id, other.id) for one, other in matched]
    if not sum(each.n for each in totals):
        return PairedEpisodes(None, "no episode was completed on both sides with the same seed.")
    return PairedEpisodes(_sum_pairs(totals))


def _find_obstacle(a: Sequence[Campaign], b: Sequence[Campaign]) -> str:
    """Return why campaigns cannot have seen the same noise; empty if they can."""
    methods = {campaign.spec.method for campaign in (*a, *b)}
    for method in list_unpairable([*a, *b]):
        return f"{method} chooses its noise by what earlier episodes did."
    if len(methods) > 1:
        return f"{' and '.join(sorted(methods))} do not draw the same noise."
    if problem := _find_other_request([campaign.spec for campaign in (*a, *b)]):
        return problem
    # Campaigns are paired by their seeds, so a seed may occur once on each side.
    seeds = [[campaign.spec.seed for campaign in side] for side in (a, b)]
    if any(len(set(side)) < len(side) for side in seeds):
        return "two campaigns of one side have the same seed."
    if set(seeds[0]) != set(seeds[1]):
        return "their seeds differ."
    return ""


def list_unpairable(campaigns: Sequence[Campaign]) -> list[str]:
    """Return the methods of campaigns whose noise depends on what earlier episodes did."""
    methods = {campaign.spec.method for campaign in campaigns}
    return sorted(method for method in methods if not traits_of(method).pairable)


def _find_other_request(specs: Sequence[CampaignSpec]) -> str:
    """Return why the specs draw different noise; empty if they do not."""
    if len({repr(spec.disturbance.noise_shape) for spec in specs}) > 1:
        return "their noise differs in shape."
    if len({list_channels(spec) for spec in specs}) > 1:
        return "their noise differs in its channels."
    # Settings are compared as text, because they may hold lists, which are not hashable.
    replayed = {repr(sorted(spec.settings.items())) for spec in specs}
    injects = traits_of(specs[0].method).injects is not Injection.NOTHING
    if injects and len(replayed) > 1:
        return "they were asked to replay different noise."
    return ""


def _find_other_noise(store: Store, one: Campaign, other: Campaign) -> str:
    """Return which sampled pair of episodes saw different noise; empty without one."""
    for first, second in _sample_pairs(store, one, other):
        # The same z, as far as both went: a failure ends its episode early.
        steps = min(first.steps, second.steps)
        same_noise = np.array_equal(first.noise.z[:steps], second.noise.z[:steps])
        if not same_noise or (first.seed, first.source) != (second.seed, second.source):
            return (
                f"the noise, or the seed, of episode {one.id}/{first.index} is not that of "
                f"{other.id}/{second.index}."
            )
    return ""


def _sample_pairs(
    store: Store, one: Campaign, other: Campaign
) -> Iterator[tuple[EpisodeResult, EpisodeResult]]:
    """Return pairs of episodes with noise, evenly spread over the campaigns."""
    reach = min(one.counts.planned, other.counts.planned)
    # Pruning leaves the noise of multiples of a number: places are multiples of all these numbers.
    records = (record for each in (one, other) for record in store.retention.of(each.id))
    each = lcm(*(record.retention.keep_every for record in records))
    places = {place * reach // PAIRS_COMPARED // each * each for place in range(PAIRS_COMPARED)}
    others = {result.index: result for result in store.episodes.finished(other.id, places)}
    for result in store.episodes.finished(one.id, places):
        partner = others.get(result.index)
        if partner is not None and result.steps and partner.steps:
            yield result, partner


def _sum_pairs(totals: Sequence[PairTotals]) -> PairTotals:
    return PairTotals(
        both=sum(each.both for each in totals),
        only_first=sum(each.only_first for each in totals),
        only_second=sum(each.only_second for each in totals),
        neither=sum(each.neither for each in totals),
    )
