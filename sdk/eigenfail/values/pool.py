"""Campaigns of one method against one system under test, taken together."""

import msgspec

from eigenfail.values.campaign import Cost, Rate, Settings
from eigenfail.values.disturbance import DisturbanceModel


class Peers(msgspec.Struct, frozen=True, kw_only=True):
    """What campaigns have in common whose costs can be held against each other.

    Attributes:
        planner_settings: those that are not the planner's defaults.
        scenario_parameters: the same of the scenario, each a value or a distribution.
    """

    planner: str
    planner_settings: Settings
    scenario: str
    scenario_parameters: Settings
    simulator: str
    disturbance: DisturbanceModel


class Pool(msgspec.Struct, frozen=True, kw_only=True):
    """The campaigns of one method among such peers, as sums.

    Attributes:
        campaigns: how many there are.
        newest: the id of the newest one.
        completed: episodes.
        failures: collisions among them.
        instance_hours: of all of them. [h]
        total_usd: of all of them. [USD]
    """

    peers: Peers
    method: str
    campaigns: int
    newest: int
    completed: int
    failures: int
    instance_hours: float
    total_usd: float


class MethodCost(msgspec.Struct, frozen=True, kw_only=True):
    """What a failure cost with one method, over all its campaigns among some peers.

    Attributes:
        campaigns: how many were pooled.
        newest: the id of the newest one.
        failure_rate: over the episodes of all of them; None before the first one.
    """

    method: str
    campaigns: int
    newest: int
    completed: int
    failures: int
    failure_rate: Rate | None
    cost: Cost


class PeerCosts(msgspec.Struct, frozen=True, kw_only=True):
    """What a failure cost among some peers, method by method.

    Attributes:
        methods: Monte Carlo first, then the cheapest first.
        notes: what is pooled, and what the numbers cannot know.
    """

    peers: Peers
    methods: tuple[MethodCost, ...]
    notes: tuple[str, ...]
