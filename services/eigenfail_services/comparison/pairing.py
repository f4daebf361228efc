"""Pairs of episodes with the same noise in two groups of campaigns."""

from collections.abc import Iterator, Sequence
from math import lcm
from typing import NamedTuple

import numpy as np

from eigenfail.contracts import Injection
from eigenfail.methods import traits_of
from eigenfail.values import (
    Campaign,
    CampaignSpec,
    EpisodeResult,
    PairTotals,
)
from eigenfail.worlds import list_channels
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
