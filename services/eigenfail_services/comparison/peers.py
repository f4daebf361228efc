"""Costs of methods, among campaigns that have everything else in common."""

from collections import defaultdict
from collections.abc import Callable, Hashable, Iterator, Sequence
from typing import Any

import msgspec

from eigenfail import plugins
from eigenfail.errors import EigenfailError
from eigenfail.methods import traits_of
from eigenfail.settings import defaults_of
from eigenfail.values.campaign import Campaign
from eigenfail.values.campaign_spec import Settings
from eigenfail.values.comparison import MethodCost, PeerCosts, Peers, Pool
from eigenfail.values.requirements import COLLISION_ALONE
from eigenfail.worlds import PluginField, world_of
from eigenfail_services.analysis import campaign_figures
from eigenfail_services.analysis.sampling_design import SamplingDesign
from eigenfail_services.comparison.seeds import price_over_seeds
from eigenfail_services.statistics.seed_spread import PairSums

ReadCampaign = Callable[[int], Campaign]

# Unlike every default, None among them.
NEW = object()

POOLED = (
    "All campaigns of a method are pooled that have planner, scenario, simulator, disturbance "
    "model and all their settings in common: their costs and failures are summed. The interval of "
    "a method that draws from p(x) is that of the pooled failure rate; that of a search is across "
    "seeds, and is there if its campaigns differ in their seeds alone. Campaigns of one method may "
    "differ in its settings."
)
LEFT_OUT = "Replays, shrunk failures and evaluated policies are left out: they find nothing new."
NO_BASELINE = "There is no Monte Carlo campaign to compare with."
AT_LEAST = (
    "Monte Carlo has found no failure: its figure is the least that one can cost there (95 %)."
)


def list_methods(pools: Sequence[Pool]) -> list[str]:
    """Return the names of the methods of all campaigns."""
    return sorted({pool.method for pool in pools})


def compare_peers(pools: Sequence[Pool], read: ReadCampaign | None = None) -> tuple[PeerCosts, ...]:
    """Return the costs of all groups of comparable campaigns, the newest campaign's group first.

    Args:
        pools: pools of campaigns.
        read: returns a campaign, for the exact figures of one that is alone in its pool.
    """
    groups: dict[Hashable, dict[str, list[Pool]]] = defaultdict(lambda: defaultdict(list))
    for pool in pools:
        if traits_of(pool.method).finds_new:
            peers = _leave_out_defaults(pool.peers)
            group = groups[_make_hashable(msgspec.to_builtins(peers))]
            group[pool.method].append(msgspec.structs.replace(pool, peers=peers))
    return tuple(
        _make_peer_costs([*map(_merge_pools, by_method.values())], read)
        for by_method in groups.values()
    )


def _leave_out_defaults(peers: Peers) -> Peers:
    """Return the peers without settings that are defaults anyway.

    The disturbance model has all its defaults filled in, so that there is nothing to leave out.
    """
    fields = world_of(peers.simulator).plugin_fields
    return msgspec.structs.replace(
        peers,
        requirements=None if peers.requirements == COLLISION_ALONE else peers.requirements,
        **{
            each.settings: _leave_out_default_settings(peers, name, each)
            for name, each in fields.items()
        },
    )


def _leave_out_default_settings(peers: Peers, name: str, field: PluginField) -> Settings:
    given: Settings = getattr(peers, field.settings)
    if not given:
        return given
    try:
        fields = getattr(plugins.load(field.group, getattr(peers, name)), field.type_name)
    except EigenfailError:  # not installed here: nothing is known of it
        return given
    types = {each.encode_name: each.type for each in msgspec.structs.fields(fields)}
    whole = {each: _complete_setting(value, types.get(each, Any)) for each, value in given.items()}
    known = defaults_of(fields)
    return {each: value for each, value in whole.items() if known.get(each, NEW) != value}


def _complete_setting(value: Any, kind: Any) -> Any:
    """Return a setting with nested defaults filled in; distributions stay unchanged."""
    try:
        return msgspec.to_builtins(msgspec.convert(value, kind))
    except msgspec.ValidationError:
        return value


def _make_hashable(value: Any) -> Hashable:
    """Return plain data as a key: equal numbers are equal, whether they are written 1 or 1.0."""
    if isinstance(value, dict):
        return frozenset((name, _make_hashable(part)) for name, part in value.items())
    return tuple(map(_make_hashable, value)) if isinstance(value, (list, tuple)) else value


def _merge_pools(pools: Sequence[Pool]) -> Pool:
    """Return the pools of one method as one; the first of them is the newest."""
    return msgspec.structs.replace(
        pools[0],
        campaigns=sum(pool.campaigns for pool in pools),
        completed=sum(pool.completed for pool in pools),
        failures=sum(pool.failures for pool in pools),
        errored=sum(pool.errored for pool in pools),
        unresolved=sum(pool.unresolved for pool in pools),
        judges_failures=any(pool.judges_failures for pool in pools),
        instance_hours=sum(pool.instance_hours for pool in pools),
        total_usd=sum(pool.total_usd for pool in pools),
        # Not known to differ in their seeds alone where some write a default down and others not.
        seeds=pools[0].seeds if len(pools) == 1 else 0,
    )


def _make_peer_costs(pools: Sequence[Pool], read: ReadCampaign | None) -> PeerCosts:
    methods = sorted((_make_method_cost(pool, read) for pool in pools), key=_rank_cost)
    return PeerCosts(
        peers=pools[0].peers, methods=tuple(methods), notes=tuple(_list_peer_notes(methods))
    )


def _make_method_cost(pool: Pool, read: ReadCampaign | None) -> MethodCost:
    design = SamplingDesign((pool.method,), pool.judges_failures)
    if pool.judges_failures and pool.campaigns == 1 and read is not None:
        # The same figures as on the page of that campaign.
        design = SamplingDesign.of_failures([read(pool.newest)])
    found = None
    if pool.completed:
        found = design.make_rate(pool.failures, pool.completed, pool.errored, pool.unresolved)
    # Episodes that were drawn from p(x) are one sample, whatever their seeds. Episodes of a search
    # depend on each other within a seed.
    seeds = pool.seeds if pool.seeds > 1 and not design.is_sampled else 0
    return MethodCost(
        method=pool.method,
        campaigns=pool.campaigns,
        newest=pool.newest,
        completed=pool.completed,
        failures=pool.failures,
        failure_rate=found,
        cost=price_over_seeds(_sum_pairs(pool), pool.instance_hours, found)
        if seeds and found
        else campaign_figures.price_failures(pool.total_usd, pool.instance_hours, found),
        seeds=seeds,
    )


def _sum_pairs(pool: Pool) -> PairSums:
    sums = (pool.total_usd, pool.failures, pool.usd_squares, pool.failure_squares)
    return PairSums(pool.seeds, *sums, pool.usd_failures)


def _rank_cost(found: MethodCost) -> tuple[bool, bool, float]:
    """Rank the baseline first, then the cheapest method, then methods without a failure."""
    price = found.cost.per_failure_usd
    return not _is_baseline(found), price is None, price or 0.0


def _is_baseline(found: MethodCost) -> bool:
    return traits_of(found.method).draws_from_prior


def _list_peer_notes(methods: Sequence[MethodCost]) -> Iterator[str]:
    yield POOLED
    yield LEFT_OUT
    baseline = next(filter(_is_baseline, methods), None)
    if baseline is None:
        yield NO_BASELINE
    elif not baseline.failures:
        yield AT_LEAST
