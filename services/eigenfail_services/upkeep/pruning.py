"""Pruning: noise and scenes of safe episodes that are removed to make room."""

import os
import socket
import time
from collections.abc import Iterator, Sequence
from contextlib import closing

import msgspec

from eigenfail.errors import Conflict, InvalidValue
from eigenfail.methods import traits_of
from eigenfail.values.campaign import FINAL_STATES, Campaign, CampaignFilter
from eigenfail.values.operations import PrunedCampaign, PruneReport, Retention, Weight
from eigenfail_services.store.clock import now_ms
from eigenfail_services.store.engine import find_backend
from eigenfail_services.store.errors import make_running_error
from eigenfail_services.store.store import Store, open_store

DAY_MS = 86_400_000
"""Ages of campaigns are given in days, and their ends are stored in milliseconds."""


class PruneSelection(msgspec.Struct, frozen=True):
    """The campaigns to prune.

    Attributes:
        campaigns: their ids; empty for all.
        older_than_days: least number of days since they ended.
    """

    campaigns: tuple[int, ...] = ()
    older_than_days: float = 0.0


class CampaignPruning(msgspec.Struct, frozen=True):
    """The noise to remove from a campaign, and whether other campaigns need the rest."""

    campaign: Campaign
    weight: Weight
    in_use: bool


def rehearse(address: str, rule: Retention, which: PruneSelection) -> PruneReport:
    """Report what a pruning would remove, without removing it.

    Raises:
        InvalidValue: the address is invalid, or a named campaign holds evidence.
        NotFound: a named campaign does not exist.
        Conflict: a named campaign has not ended.
        StoreUnavailable: the database does not exist, or does not answer.
        SchemaMismatch: its schema is not this program's.
    """
    with closing(open_store(address, migrate=False)) as store:
        in_use = store.retention.in_use()
        found = [
            CampaignPruning(each, Weight(), True)
            if each.id in in_use
            else CampaignPruning(each, store.retention.weigh(each.id, rule), False)
            for each in _find_campaigns(store, which)
        ]
    return _make_report(address, rule, found, is_rehearsal=True)


def prune(address: str, rule: Retention, which: PruneSelection) -> PruneReport:
    """Remove noise and record it; raises the errors of `rehearse`, and StoreUnwritable."""
    who = _find_user()
    with closing(open_store(address, migrate=False)) as store:
        # All campaigns are found before the first is pruned: a wrong name is refused while nothing
        # has been deleted.
        found = [
            _prune_campaign(store, each, rule, who) for each in list(_find_campaigns(store, which))
        ]
    return _make_report(address, rule, found, is_rehearsal=False)


def _make_report(
    address: str, rule: Retention, found: Sequence[CampaignPruning], *, is_rehearsal: bool
) -> PruneReport:
    """Return the report, without campaigns that lose nothing."""
    return PruneReport(
        find_backend(address).label,
        rule,
        is_rehearsal,
        tuple(
            PrunedCampaign(each.campaign.id, each.campaign.spec.name, each.weight)
            for each in found
            if each.weight.episodes
        ),
        tuple(each.campaign.id for each in found if each.in_use),
    )


def _prune_campaign(store: Store, campaign: Campaign, rule: Retention, who: str) -> CampaignPruning:
    """Prune a campaign slice by slice, until other campaigns need the rest.

    The pauses leave other writers at least half of the time.
    """
    weight, begun = Weight(), None
    while True:
        before_s = time.monotonic()
        try:
            record = store.retention.prune(campaign.id, rule, who, begun)
        except Conflict:  # it has ended, for good: so it is this
            return CampaignPruning(campaign, weight, True)
        if record is None:
            return CampaignPruning(campaign, weight, False)
        weight, begun = record.weight, record.id
        # As long as the slice took: a database with one writer is free half of the time.
        time.sleep(time.monotonic() - before_s)


def _find_user() -> str:
    """Return the user and the machine, for the record."""
    user = os.environ.get("USER") or f"user {os.getuid()}"
    return f"{user}@{socket.gethostname()}"


def _find_campaigns(store: Store, which: PruneSelection) -> Iterator[Campaign]:
    """Yield the selected campaigns that may lose noise."""
    before_ms = now_ms() - which.older_than_days * DAY_MS
    for campaign in _find_named(store, which.campaigns) if which.campaigns else _list_ended(store):
        # Young campaigns are passed over in silence, also if they are named.
        if campaign.ended_ms is not None and campaign.ended_ms <= before_ms:
            yield campaign


def _find_named(store: Store, wanted: tuple[int, ...]) -> Iterator[Campaign]:
    """Yield the named campaigns.

    Raises:
        NotFound: one does not exist.
        Conflict: one has not ended.
        InvalidValue: one holds evidence.
    """
    for number in wanted:
        campaign = store.campaigns.get(number)
        if campaign.state not in FINAL_STATES:
            raise make_running_error(campaign)
        if traits_of(campaign.spec.method).is_evidence:
            problem = f"{number} is one of {campaign.spec.method}: its noise is a proof."
            raise InvalidValue("campaign", problem, "Its few episodes are kept whole.")
        yield campaign


def _list_ended(store: Store) -> Iterator[Campaign]:
    """Yield all campaigns that have ended, except those that hold evidence."""
    for state in sorted(FINAL_STATES):
        for campaign in store.campaigns.iterate(CampaignFilter(state=state)):
            if not traits_of(campaign.spec.method).is_evidence:
                yield campaign
