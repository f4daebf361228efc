"""A campaign that runs: whose job it is, the time that it is billed, and when that ends it."""

import time

from msgspec.structs import replace

from eigenfail.contracts import Store
from eigenfail.errors import ClaimLost, StoreUnavailable
from eigenfail.values import Campaign, Counts, Priority
from eigenfail.values.records import Job
from eigenfail_services.campaigns import stopping
from eigenfail_services.campaigns.summary import campaign_cost
from eigenfail_services.hub.meter import Meter


class Watch:
    """A campaign that runs on our hub, the job that says it is ours, and the time it is billed."""

    def __init__(self, job: Job, priority: Priority = Priority.NORMAL) -> None:
        self.job = job
        self.priority = priority
        self.meter = Meter()
        self.billed_s = time.monotonic()
        self.told: Counts | None = None
        self.halting = False
        self.lost = False
        self.spent = ""

    def has_new(self, priority: Priority) -> bool:
        """Whether this is another priority than it was; it is from now on."""
        before, self.priority = self.priority, priority
        return before is not priority

    def so_far(self, campaign: Campaign) -> Campaign:
        """The campaign with the time that is not yet billed."""
        unbilled_s = time.monotonic() - self.billed_s
        return replace(campaign, active_s=campaign.active_s + unbilled_s)

    def billed(self, store: Store) -> bool:
        """Bill the time until now; False if the campaign is somebody else's by now."""
        try:
            self.bill(store)
        except ClaimLost:
            return False
        return True

    def bill(self, store: Store) -> None:
        """Add the time since the last bill; it stays open while the store is away.

        Raises:
            StoreUnavailable: it could not be added.
            ClaimLost: the campaign is somebody else's by now, and so is its time.
        """
        overhead = self.meter.take()  # before the clock is read: no part is more than the whole
        now_s = time.monotonic()
        try:
            store.campaigns.add_active(self.job.subject, now_s - self.billed_s, overhead, self.job)
        except StoreUnavailable:
            self.meter.give_back(overhead)
            raise
        self.billed_s = now_s


def spent(campaign: Campaign) -> str:
    """Why the campaign's rules on time and cost end it; empty if they do not."""
    return stopping.by_time(
        campaign.spec.stop, campaign.active_s, campaign_cost(campaign).total_usd
    )
