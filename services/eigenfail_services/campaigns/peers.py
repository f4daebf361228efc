"""What a failure costs, method by method, over all campaigns that may be compared."""

from collections import defaultdict
from collections.abc import Hashable, Iterator, Sequence
from typing import Any

import msgspec

from eigenfail import bridges, plugins
from eigenfail.errors import EigenfailError
from eigenfail.settings import defaults_of
from eigenfail.values.campaign import Settings
from eigenfail.values.pool import MethodCost, PeerCosts, Peers, Pool
from eigenfail_services.analysis.cost import SECONDS_PER_HOUR, cost
from eigenfail_services.statistics.intervals import rate

BASELINE = "monte_carlo"
NEW = object()
NOTHING_NEW = frozenset({"evaluate", "minimal", "replay"})
"""Methods whose campaigns rest on failures or policies that others have paid for."""

POOLED = (
    "All campaigns of a method are pooled that have planner, scenario, simulator, disturbance "
    "model and all their settings in common: their costs and failures are summed, and intervals "
    "are those of the pooled failure rate. Campaigns of one method may differ in its settings."
)
LEFT_OUT = "Replays, shrunk failures and evaluated policies are left out: they find nothing new."
NO_BASELINE = "There is no Monte Carlo campaign to hold these against."
AT_LEAST = (
    "Monte Carlo has found no failure: its figure is the least that one can cost there (95 %)."
)


def methods_of(pools: Sequence[Pool]) -> list[str]:
    """The methods of all campaigns."""
    return sorted({pool.method for pool in pools})


def peer_costs(pools: Sequence[Pool]) -> tuple[PeerCosts, ...]:
    """The costs of all groups of peers, those with the newest campaign first."""
    groups: dict[Hashable, dict[str, list[Pool]]] = defaultdict(lambda: defaultdict(list))
    for pool in pools:
        if pool.method not in NOTHING_NEW:
            peers = without_defaults(pool.peers)
            group = groups[hashable(msgspec.to_builtins(peers))]
            group[pool.method].append(msgspec.structs.replace(pool, peers=peers))
    return tuple(costs_of([*map(merged, by_method.values())]) for by_method in groups.values())


def without_defaults(peers: Peers) -> Peers:
    """The same peers, whether or not a campaign wrote a default down.

    The disturbance model has all its defaults filled in, so that there is nothing to leave out.
    """
    if peers.simulator == bridges.SIMULATOR:
        return peers
    scenario = told(peers.scenario_parameters, plugins.SCENARIOS, peers.scenario, "Parameters")
    planner = told(peers.planner_settings, plugins.PLANNERS, peers.planner, "Settings")
    return msgspec.structs.replace(peers, scenario_parameters=scenario, planner_settings=planner)


def told(given: Settings, group: str, name: str, kind: str) -> Settings:
    """Of a plug-in's settings, those that are not its defaults."""
    if not given:
        return given
    try:
        fields = getattr(plugins.load(group, name), kind)
    except EigenfailError:  # not installed here: nothing is known of it
        return given
    types = {each.encode_name: each.type for each in msgspec.structs.fields(fields)}
    whole = {each: completed(value, types.get(each, Any)) for each, value in given.items()}
    known = defaults_of(fields)
    return {each: value for each, value in whole.items() if known.get(each, NEW) != value}


def completed(value: Any, kind: Any) -> Any:
    """A setting with the defaults inside it; a distribution, which stands for one, as it is."""
    try:
        return msgspec.to_builtins(msgspec.convert(value, kind))
    except msgspec.ValidationError:
        return value


def hashable(value: Any) -> Hashable:
    """Plain data to be grouped by: numbers that are equal are one, however they are written."""
    if isinstance(value, dict):
        return frozenset((name, hashable(part)) for name, part in value.items())
    return tuple(map(hashable, value)) if isinstance(value, list) else value


def merged(pools: Sequence[Pool]) -> Pool:
    """Pools of one method among such peers, as one; the first of them is the newest."""
    return msgspec.structs.replace(
        pools[0],
        campaigns=sum(pool.campaigns for pool in pools),
        completed=sum(pool.completed for pool in pools),
        failures=sum(pool.failures for pool in pools),
        instance_hours=sum(pool.instance_hours for pool in pools),
        total_usd=sum(pool.total_usd for pool in pools),
    )


def costs_of(pools: Sequence[Pool]) -> PeerCosts:
    """The costs of one group."""
    methods = sorted(map(method_cost, pools), key=place)
    return PeerCosts(peers=pools[0].peers, methods=tuple(methods), notes=tuple(notes(methods)))


def method_cost(pool: Pool) -> MethodCost:
    """What a failure cost with one method."""
    hours = pool.instance_hours
    return MethodCost(
        method=pool.method,
        campaigns=pool.campaigns,
        newest=pool.newest,
        completed=pool.completed,
        failures=pool.failures,
        failure_rate=rate(pool.failures, pool.completed) if pool.completed else None,
        cost=cost(
            active_s=hours * SECONDS_PER_HOUR,
            instances=1,
            price_usd_per_hour=pool.total_usd / hours if hours else 0.0,
            failures=pool.failures,
            completed=pool.completed,
        ),
    )


def place(found: MethodCost) -> tuple[bool, bool, float]:
    """Monte Carlo first, then the cheapest, then those without a failure."""
    price = found.cost.per_failure_usd
    return found.method != BASELINE, price is None, price or 0.0


def notes(methods: Sequence[MethodCost]) -> Iterator[str]:
    """What the figures are, and what they cannot know."""
    yield POOLED
    yield LEFT_OUT
    baseline = next((each for each in methods if each.method == BASELINE), None)
    if baseline is None:
        yield NO_BASELINE
    elif not baseline.failures:
        yield AT_LEAST
