"""What the later part of a campaign's page tells, worked out beside the page itself.

A database sums without holding Python's lock, so several questions are answered at a time.
"""

from collections.abc import Sequence
from concurrent.futures import Future, ThreadPoolExecutor, wait
from typing import Any, NamedTuple

from eigenfail.contracts import Store
from eigenfail.values import Campaign, CampaignCost, Safety
from eigenfail.values.worker import WorkerShare
from eigenfail_services.campaigns.crew import workers_of
from eigenfail_services.campaigns.safety import safety_of
from eigenfail_services.campaigns.spending import spending_of

AT_A_TIME = 3
POOL = ThreadPoolExecutor(AT_A_TIME, thread_name_prefix="figures")


class Measured(NamedTuple):
    """Safety, cost and workers of a campaign."""

    safety: Safety
    cost: CampaignCost
    workers: tuple[WorkerShare, ...]


def measured(store: Store, campaign: Campaign) -> Measured:
    """All three; what the store has to sum is summed side by side."""
    finish(begin(store, campaign))
    return remembered(store, campaign)


def remembered(store: Store, campaign: Campaign) -> Measured:
    """All three, where the store knows the sums: nobody waits behind those of other campaigns."""
    return Measured(
        safety_of(store, campaign), spending_of(store, campaign), workers_of(store, campaign)
    )


def begin(store: Store, campaign: Campaign) -> Sequence[Future[Any]]:
    """Have a store find what `measured` will ask it for; it remembers what it found."""
    asked = (store.episodes.safety, store.episodes.spending, store.figures.workers)
    return [POOL.submit(ask, campaign.id) for ask in asked]


def is_done(begun: Sequence[Future[Any]]) -> bool:
    """Whether all is known by now."""
    return all(each.done() and not each.exception() for each in begun)


def finish(begun: Sequence[Future[Any]]) -> None:
    """Wait until all is done, be it in vain: whoever asks for the answer is told why."""
    wait(begun)
