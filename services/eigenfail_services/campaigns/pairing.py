"""Whether the episodes of two groups of campaigns saw the same noise, one by one."""

from collections.abc import Iterator, Sequence
from math import lcm
from typing import NamedTuple

import numpy as np

from eigenfail.contracts import Store
from eigenfail.values import Campaign, CampaignSpec, EpisodeResult, PairTotals

DRAWS_FROM_PRIOR = "monte_carlo"
REPLAYS = "replay"
PAIRABLE = frozenset({DRAWS_FROM_PRIOR, REPLAYS})
"""Methods whose noise does not depend on what earlier episodes did."""

LOOKED_AT = 32
"""How many pairs of episodes of each pair of campaigns are read, to see that noise is the same."""


class Pairing(NamedTuple):
    """The pairs of all campaigns of one seed together, or why there are none."""

    totals: PairTotals | None
    because: str = ""


def pair(store: Store, a: Sequence[Campaign], b: Sequence[Campaign]) -> Pairing:
    """Pair episodes of equal index of campaigns of equal seed, where they saw the same noise."""
    if problem := obstacle(a, b):
        return Pairing(None, problem)
    by_seed = {campaign.spec.seed: campaign for campaign in b}
    matched = [(campaign, by_seed[campaign.spec.seed]) for campaign in a]
    for one, other in matched:
        if problem := other_noise(store, one, other):
            return Pairing(None, problem)
    totals = [store.episodes.paired(one.id, other.id) for one, other in matched]
    if not sum(each.n for each in totals):
        return Pairing(None, "no episode was completed on both sides with the same seed.")
    return Pairing(added(totals))


def obstacle(a: Sequence[Campaign], b: Sequence[Campaign]) -> str:
    """Why these campaigns cannot have seen the same noise; empty if they can."""
    methods = {campaign.spec.method for campaign in (*a, *b)}
    for method in sorted(methods - PAIRABLE):
        return f"{method} chooses its noise by what earlier episodes did."
    if len(methods) > 1:
        return f"{' and '.join(sorted(methods))} do not draw the same noise."
    if problem := other_question(methods, [campaign.spec for campaign in (*a, *b)]):
        return problem
    seeds = [[campaign.spec.seed for campaign in side] for side in (a, b)]
    if any(len(set(side)) < len(side) for side in seeds):
        return "two campaigns of one side have the same seed."
    if set(seeds[0]) != set(seeds[1]):
        return "their seeds differ."
    return ""


def other_question(methods: set[str], specs: Sequence[CampaignSpec]) -> str:
    """That what was asked for makes other noise; empty if it does not."""
    if len({repr(spec.disturbance.shape) for spec in specs}) > 1:
        return "their noise differs in shape."
    replayed = {repr(sorted(spec.settings.items())) for spec in specs}
    if REPLAYS in methods and len(replayed) > 1:
        return "they were asked to replay different noise."
    return ""


def other_noise(store: Store, one: Campaign, other: Campaign) -> str:
    """That a pair of episodes saw different noise, if one of those looked at did."""
    for first, second in some_pairs(store, one, other):
        if not same_noise(first, second):
            return (
                f"the noise of episode {one.id}/{first.index} is not that of "
                f"{other.id}/{second.index}."
            )
    return ""


def some_pairs(
    store: Store, one: Campaign, other: Campaign
) -> Iterator[tuple[EpisodeResult, EpisodeResult]]:
    """Some pairs of episodes with noise, spread over the campaigns."""
    reach = min(one.counts.planned, other.counts.planned)
    each = spared(store, one, other)
    places = {place * reach // LOOKED_AT // each * each for place in range(LOOKED_AT)}
    others = {result.index: result for result in store.episodes.finished(other.id, places)}
    for result in store.episodes.finished(one.id, places):
        partner = others.get(result.index)
        if partner is not None and result.steps and partner.steps:
            yield result, partner


def spared(store: Store, *campaigns: Campaign) -> int:
    """The number whose multiples have kept their noise in all of these campaigns."""
    records = (record for each in campaigns for record in store.retention.of(each.id))
    return lcm(*(record.retention.keep_every for record in records))


def same_noise(first: EpisodeResult, second: EpisodeResult) -> bool:
    """Whether two episodes were given the same z, as far as both went."""
    steps = min(first.steps, second.steps)
    same = np.array_equal(first.noise.z[:steps], second.noise.z[:steps])
    return same and (first.seed, first.source) == (second.seed, second.source)


def added(totals: Sequence[PairTotals]) -> PairTotals:
    """The pairs of several campaigns together."""
    return PairTotals(
        both=sum(each.both for each in totals),
        only_first=sum(each.only_first for each in totals),
        only_second=sum(each.only_second for each in totals),
        neither=sum(each.neither for each in totals),
    )
