"""Whether two groups of campaigns can be compared: the same noise, and the same request."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from math import lcm
from typing import NamedTuple

import msgspec
import numpy as np
from msgspec.structs import replace

from eigenfail.contracts import Injection
from eigenfail.methods import traits_of
from eigenfail.suites import list_leaves
from eigenfail.values import (
    Campaign,
    CampaignSpec,
    Distinction,
    EpisodeResult,
    PairTotals,
)
from eigenfail.worlds import list_channels
from eigenfail_services.campaigns.drafts import fill_defaults
from eigenfail_services.store import Store

PAIRS_COMPARED = 32
"""Pairs of episodes of each pair of campaigns that are read to check that their noise is equal."""


class PairedEpisodes(NamedTuple):
    """Pairs of episodes with the same noise, counted, or the reason why there are none."""

    totals: PairTotals | None
    because: str = ""


def pair_episodes(store: Store, a: Sequence[Campaign], b: Sequence[Campaign]) -> PairedEpisodes:
    """Pair episodes of equal index of campaigns of equal seed, where they saw the same noise."""
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
    """Return which difference of the specs makes other noise; empty without one."""
    if len({repr(spec.disturbance.noise_shape) for spec in specs}) > 1:
        return "their noise differs in shape."
    if len({list_channels(spec) for spec in specs}) > 1:
        return "their noise differs in its channels."
    replayed = {repr(sorted(spec.settings.items())) for spec in specs}
    injects = traits_of(specs[0].method).injects is not Injection.NOTHING
    if injects and len(replayed) > 1:
        return "they were asked to replay different noise."
    return ""


def _find_other_noise(store: Store, one: Campaign, other: Campaign) -> str:
    """Return which sampled pair of episodes saw different noise; empty without one."""
    for first, second in _sample_pairs(store, one, other):
        if not _is_same_noise(first, second):
            return (
                f"the noise of episode {one.id}/{first.index} is not that of "
                f"{other.id}/{second.index}."
            )
    return ""


def _sample_pairs(
    store: Store, one: Campaign, other: Campaign
) -> Iterator[tuple[EpisodeResult, EpisodeResult]]:
    """Return pairs of episodes with noise, evenly spread over the campaigns."""
    reach = min(one.counts.planned, other.counts.planned)
    each = _find_kept_multiple(store, one, other)
    places = {place * reach // PAIRS_COMPARED // each * each for place in range(PAIRS_COMPARED)}
    others = {result.index: result for result in store.episodes.finished(other.id, places)}
    for result in store.episodes.finished(one.id, places):
        partner = others.get(result.index)
        if partner is not None and result.steps and partner.steps:
            yield result, partner


def _find_kept_multiple(store: Store, *campaigns: Campaign) -> int:
    """Return the number whose multiples have kept their noise in all campaigns after pruning."""
    records = (record for each in campaigns for record in store.retention.of(each.id))
    return lcm(*(record.retention.keep_every for record in records))


def _is_same_noise(first: EpisodeResult, second: EpisodeResult) -> bool:
    """Return whether two episodes were given the same z, as far as both went."""
    steps = min(first.steps, second.steps)
    same = np.array_equal(first.noise.z[:steps], second.noise.z[:steps])
    return same and (first.seed, first.source) == (second.seed, second.source)


def _sum_pairs(totals: Sequence[PairTotals]) -> PairTotals:
    return PairTotals(
        both=sum(each.both for each in totals),
        only_first=sum(each.only_first for each in totals),
        only_second=sum(each.only_second for each in totals),
        neither=sum(each.neither for each in totals),
    )


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
"""Which thing a field of a spec belongs to; the others change no result."""

DEFAULT = "default"

NO_VERSION = "not given"
"""The value of `planner_version` in a spec without one: there is no default version."""

NOTHING = "–"
"""The value of a setting that a plug-in does not have, or that is None."""

OWNERS = {
    "settings": "method",
    "planner_settings": "planner",
    "scenario_parameters": "scenario",
}
"""The field of a spec that names the plug-in to which the settings of another field belong."""

FlatSpec = Mapping[str, str]
"""The values of a spec as text, by dotted path."""


def find_distinctions(
    a: Sequence[CampaignSpec], b: Sequence[CampaignSpec]
) -> tuple[Distinction, ...]:
    """Return every setting whose values differ between the sides, in the order of `THINGS`.

    Defaults are resolved on both sides, so that writing one out makes no difference. A setting that
    only one side's plug-ins have is listed if a campaign gives it another value than the default.
    The version of the planner is one of them: a campaign without one differs from one with it.
    """
    left, right = _flatten_all(a), _flatten_all(b)
    shared = _list_paths(left) & _list_paths(right)
    of_one_side = (_list_paths(left) ^ _list_paths(right)) & _find_chosen_paths([*a, *b])
    all_specs = [*left, *right]
    compared = (
        (path, _find_values(left, path, all_specs), _find_values(right, path, all_specs))
        for path in sorted(shared | of_one_side, key=_rank_path)
    )
    return tuple(
        Distinction(path, ", ".join(one), ", ".join(other))
        for path, one, other in compared
        if one != other
    )


def _flatten_all(specs: Sequence[CampaignSpec]) -> list[FlatSpec]:
    return [flatten_spec(spec) for spec in specs]


def _list_paths(side: Iterable[FlatSpec]) -> set[str]:
    """Return the paths of the settings on which results depend."""
    return {path for spec in side for path in spec if path.partition(".")[0] in THINGS}


def _find_values(
    side: Iterable[FlatSpec], path: str, all_specs: Iterable[FlatSpec]
) -> tuple[str, ...]:
    """Return the different values of a setting over the campaigns of a side."""
    found = {spec.get(path) or _name_absent(path, spec, all_specs) for spec in side}
    return tuple(sorted(found))


def _name_absent(path: str, spec: FlatSpec, all_specs: Iterable[FlatSpec]) -> str:
    """Return the value of a setting that a spec does not have.

    It is the default only if the plug-in has such a setting, as another campaign of it shows.
    """
    if path == "planner_version":
        return NO_VERSION
    owner = OWNERS.get(path.partition(".")[0])
    alike = (other for other in all_specs if owner is None or other[owner] == spec[owner])
    return DEFAULT if any(path in other for other in alike) else NOTHING


def find_differing_fields(found: Iterable[Distinction]) -> tuple[str, ...]:
    """Return the fields that the distinctions belong to, each once."""
    return tuple(dict.fromkeys(THINGS[each.thing.partition(".")[0]] for each in found))


def find_mixed_fields(specs: Sequence[CampaignSpec]) -> tuple[str, ...]:
    """Return the fields in which the campaigns of one side differ among themselves."""
    side = _flatten_all(specs)
    return find_differing_fields(
        Distinction(path, "", "")
        for path in sorted(_list_paths(side), key=_rank_path)
        if len(_find_values(side, path, side)) > 1
    )


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


def flatten_spec(spec: CampaignSpec) -> dict[str, str]:
    """Return every value of a spec, defaults included, as text by dotted path."""
    plain = msgspec.to_builtins(fill_defaults(spec))
    named = [f"{each.in_words()} (scale {each.scale:g})" for each in spec.all_requirements]
    values = list_leaves(plain | {"requirements": "; ".join(named)})
    return {
        ".".join(path): NOTHING if value is None else str(value)
        for path, value in values
        if value != {}
    }


def _rank_path(path: str) -> tuple[int, str]:
    return list(THINGS).index(path.partition(".")[0]), path
