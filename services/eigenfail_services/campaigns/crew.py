"""Who works, and who did."""

from eigenfail.contracts import Store
from eigenfail.values import Campaign
from eigenfail.values.worker import Presence, WorkerShare
from eigenfail_services.store.clock import now_ms

LATELY_S = 600
ACTIVE_S = 60
"""Who brought a result within so many seconds is at work."""

PRESENT_S = 30
"""Whom no hub has named for so many seconds is not there: hubs do so every few seconds."""


def workers_of(store: Store, campaign: Campaign) -> tuple[WorkerShare, ...]:
    """Who ran the episodes of a campaign; who ran most comes first."""
    return store.figures.workers(campaign.id)


def lately(store: Store, within_s: int = LATELY_S) -> tuple[WorkerShare, ...]:
    """Who brought results within some seconds, and of which campaigns; only these are counted."""
    return store.figures.workers_since(now_ms() - 1_000 * within_s)


def present(store: Store) -> tuple[Presence, ...]:
    """Who is connected to a hub now, by name, at work or not."""
    return store.roster.present(now_ms() - 1_000 * PRESENT_S)
