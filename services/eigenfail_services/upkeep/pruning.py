"""Noise that is taken away to make room, of all campaigns that may lose it.

A service may use the database meanwhile: each slice is a short transaction of its own, and there
is a pause behind it. What was killed is begun again, and goes on where noise is left.
"""

import os
import socket
import time
from collections.abc import Iterator, Sequence
from contextlib import closing

import msgspec

from eigenfail.contracts import Store
from eigenfail.errors import Conflict, InvalidValue
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


class Which(msgspec.Struct, frozen=True):
    """Which campaigns are meant.

    Attributes:
        campaigns: by their ids; none stands for all.
        older_than_days: since they ended.
    """

    campaigns: tuple[int, ...] = ()
    older_than_days: float = 0.0


class Found(msgspec.Struct, frozen=True):
    """What goes of a campaign, or went; and whether others need what is left."""

    campaign: Campaign
    weight: Weight
    in_use: bool


def rehearse(address: str, rule: Retention, which: Which) -> PruneReport:
    """What a pruning would take away; nothing changes.

    Raises:
        InvalidValue: the address is none, or a campaign that is named is one of replays.
        NotFound: no such campaign.
        Conflict: a campaign that is named has not ended.
        StoreUnavailable: there is no database, or it does not answer.
        SchemaMismatch: its schema is another.
    """
    with closing(open_store(address, migrate=False)) as store:
        in_use = store.retention.in_use()
        found = [
            Found(each, Weight(), True)
            if each.id in in_use
            else Found(each, store.retention.weigh(each.id, rule), False)
            for each in meant(store, which)
        ]
    return report(address, rule, found, is_rehearsal=True)


def prune(address: str, rule: Retention, which: Which) -> PruneReport:
    """Take it away, and record it; raises what `rehearse` does, and StoreUnwritable."""
    who = whoever_asks()
    with closing(open_store(address, migrate=False)) as store:
        found = [taken(store, each, rule, who) for each in list(meant(store, which))]
    return report(address, rule, found, is_rehearsal=False)


def report(
    address: str, rule: Retention, found: Sequence[Found], *, is_rehearsal: bool
) -> PruneReport:
    """What comes of each campaign; those of which nothing goes are left out."""
    return PruneReport(
        find(address).label,
        rule,
        is_rehearsal,
        tuple(
            PrunedCampaign(each.campaign.id, each.campaign.spec.name, each.weight)
            for each in found
            if each.weight.episodes
        ),
        tuple(each.campaign.id for each in found if each.in_use),
    )


def taken(store: Store, campaign: Campaign, rule: Retention, who: str) -> Found:
    """Slice by slice, until others need the rest; who else writes has half of the time at least."""
    weight, begun = Weight(), None
    while True:
        before_s = time.monotonic()
        try:
            record = store.retention.prune(campaign.id, rule, who, begun)
        except Conflict:  # it has ended, for good: so it is this
            return Found(campaign, weight, True)
        if record is None:
            return Found(campaign, weight, False)
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
