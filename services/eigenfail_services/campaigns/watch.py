"""A campaign that runs: whose job it is, the time that it is billed, and when that ends it."""

import time
from math import isclose
from typing import NamedTuple

from msgspec.structs import replace

from eigenfail.contracts import Store
from eigenfail.errors import ClaimLost
from eigenfail.values import Campaign, Counts, Overhead, Priority
from eigenfail.values.records import Job
from eigenfail_services.campaigns import stopping
from eigenfail_services.campaigns.summary import campaign_cost
from eigenfail_services.hub.meter import Meter


class Bill(NamedTuple):
    """The time between two moments of our clock, and what it went into. [s]"""

    since_s: float
    until_s: float
    overhead: Overhead

    @property
    def length_s(self) -> float:
        """What it adds to the campaign's time."""
        return self.until_s - self.since_s


class Watch:
    """A campaign that runs on our hub, the job that says it is ours, and the time it is billed.

    Args:
        job: our claim; nobody else bills the campaign as long as it holds.
        priority: as the hub was told.
        kept_s: the campaign's active time as the store has it.
    """

    def __init__(self, job: Job, priority: Priority = Priority.NORMAL, kept_s: float = 0.0) -> None:
        self.job = job
        self.priority = priority
        self.meter = Meter()
        self._kept_s = kept_s
        self._billed_s = time.monotonic()
        self._unanswered: Bill | None = None
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
        unbilled_s = time.monotonic() - self._billed_s
        return replace(campaign, active_s=self._kept_s + unbilled_s)

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
        self._look_up(store)
        overhead = self.meter.take()  # before the clock is read: no part is more than the whole
        bill = self._unanswered = Bill(self._billed_s, time.monotonic(), overhead)
        store.campaigns.add_active(self.job.subject, bill.length_s, overhead, self.job)
        self._keep(bill)

    def claim_again(self, job: Job, campaign: Campaign) -> None:
        """It is ours anew: whoever had it in between may have billed it.

        Args:
            job: our new claim.
            campaign: as the store has it.
        """
        if bill := self._unanswered:
            if isclose(campaign.active_s, self._kept_s + bill.length_s):
                self._keep(bill)
            else:
                self._forget(bill)
        self.job, self._kept_s = job, campaign.active_s

    def _look_up(self, store: Store) -> None:
        """A bill that got no answer may have been kept all the same: the campaign's time tells."""
        if (bill := self._unanswered) is None:
            return
        kept_s = store.campaigns.get(self.job.subject).active_s
        if kept_s > self._kept_s + bill.length_s / 2:
            self._keep(bill)
        else:
            self._forget(bill)

    def _forget(self, bill: Bill) -> None:
        self.meter.give_back(bill.overhead)
        self._unanswered = None

    def _keep(self, bill: Bill) -> None:
        self._kept_s += bill.length_s
        self._billed_s, self._unanswered = bill.until_s, None


def spent(campaign: Campaign) -> str:
    """Why the campaign's rules on time and cost end it; empty if they do not."""
    return stopping.by_time(
        campaign.spec.stop, campaign.active_s, campaign_cost(campaign).total_usd
    )
