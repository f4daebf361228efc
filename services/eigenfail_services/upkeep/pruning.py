"""Noise that is taken away to make room, of all campaigns that may lose it.

A service may use the database meanwhile: each slice is a short transaction of its own, and there
is a pause behind it. What was killed is begun again, and goes on where noise is left.
"""

import os
import socket
import time
from collections.abc import Callable, Iterator, Mapping
from contextlib import closing
from typing import Any

import msgspec

from eigenfail.contracts import Store
from eigenfail.errors import InvalidValue
from eigenfail.values import FINAL_STATES, Campaign, CampaignState
from eigenfail.values.retention import PrunedCampaign, PruneReport, Retention, Weight
from eigenfail_services.store import open_store
from eigenfail_services.store.clock import now_ms
from eigenfail_services.store.engine import find
from eigenfail_services.store.refusals import not_ended

PAGE = 200
DAY_MS = 86_400_000

EVIDENCE = frozenset({"replay", "minimal"})
"""Methods whose every episode shows something: their noise is asked for by proofs."""

NAMING = frozenset({"campaign", "data_from"})
"""Settings of methods that name campaigns whose noise is injected or learnt from."""


class Which(msgspec.Struct, frozen=True):
    """Which campaigns are meant.

    Attributes:
        campaigns: by their ids; none stands for all.
        older_than_days: since they ended.
    """

    campaigns: tuple[int, ...] = ()
    older_than_days: float = 0.0


def rehearse(address: str, rule: Retention, which: Which) -> PruneReport:
    """What a pruning would take away; nothing changes.

    Raises:
        InvalidValue: the address is none, or a campaign that is named is one of replays.
        NotFound: no such campaign.
        Conflict: a campaign that is named has not ended.
        StoreUnavailable: there is no database, or it does not answer.
        SchemaMismatch: its schema is another.
    """

    def weighed(store: Store, campaign: int) -> Weight:
        return store.retention.weigh(campaign, rule)

    return report(address, rule, which, weighed)


def prune(address: str, rule: Retention, which: Which) -> PruneReport:
    """Take it away, and record it; raises what `rehearse` does, and StoreUnwritable."""
    who = whoever_asks()
    found = report(address, rule, which, lambda store, campaign: taken(store, campaign, rule, who))
    return msgspec.structs.replace(found, is_rehearsal=False)


def report(
    address: str, rule: Retention, which: Which, weight_of: Callable[[Store, int], Weight]
) -> PruneReport:
    """What comes of each campaign; those of which nothing goes are left out."""
    with closing(open_store(address, migrate=False)) as store:
        in_use = named_by_others(store)
        chosen = list(meant(store, which))
        pruned = [
            PrunedCampaign(each.id, each.spec.name, weight)
            for each in chosen
            if each.id not in in_use and (weight := weight_of(store, each.id)).episodes
        ]
        passed = tuple(each.id for each in chosen if each.id in in_use)
    return PruneReport(find(address).label, rule, True, tuple(pruned), passed)


def taken(store: Store, campaign: int, rule: Retention, who: str) -> Weight:
    """Slice by slice; who else writes has at least half of the time."""
    weight, begun = Weight(), None
    while True:
        before_s = time.monotonic()
        record = store.retention.prune(campaign, rule, who, begun)
        if record is None:
            return weight
        weight, begun = record.weight, record.id
        time.sleep(time.monotonic() - before_s)


def whoever_asks() -> str:
    """User and machine."""
    user = os.environ.get("USER") or f"user {os.getuid()}"
    return f"{user}@{socket.gethostname()}"


def meant(store: Store, which: Which) -> Iterator[Campaign]:
    """The campaigns that may lose noise."""
    before_ms = now_ms() - which.older_than_days * DAY_MS
    for campaign in named(store, which.campaigns) if which.campaigns else all_ended(store):
        if campaign.ended_ms is not None and campaign.ended_ms <= before_ms:
            yield campaign


def named(store: Store, wanted: tuple[int, ...]) -> Iterator[Campaign]:
    """Those that were asked for.

    Raises:
        NotFound: no such campaign.
        Conflict: one has not ended.
        InvalidValue: one is of replays.
    """
    for number in wanted:
        campaign = store.campaigns.get(number)
        if campaign.state not in FINAL_STATES:
            raise not_ended(campaign)
        if campaign.spec.method in EVIDENCE:
            problem = f"{number} is one of {campaign.spec.method}: its noise is a proof."
            raise InvalidValue("campaign", problem, "Its few episodes are kept whole.")
        yield campaign


def all_ended(store: Store) -> Iterator[Campaign]:
    """All that have ended, but for replays."""
    for state in sorted(FINAL_STATES):
        for campaign in in_state(store, state):
            if campaign.spec.method not in EVIDENCE:
                yield campaign


def in_state(store: Store, state: CampaignState) -> Iterator[Campaign]:
    """All campaigns of a state, newest first."""
    page = store.campaigns.page(PAGE, state=state)
    yield from page.items
    while page.next is not None:
        page = store.campaigns.page(PAGE, page.next, state=state)
        yield from page.items


def named_by_others(store: Store) -> frozenset[int]:
    """Campaigns whose noise one that has not ended learns from, or injects again."""
    alive = [state for state in CampaignState if state not in FINAL_STATES]
    settings = (each.spec.settings for state in alive for each in in_state(store, state))
    return frozenset(number for each in settings for number in numbers(each))


def numbers(settings: Mapping[str, Any]) -> Iterator[int]:
    """The campaigns that settings name, those of an ensemble's members included."""
    for name, value in settings.items():
        if isinstance(value, Mapping):
            yield from numbers(value)
        if name in NAMING:
            yield from value if isinstance(value, list | tuple) else filter(None, [value])
