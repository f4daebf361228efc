"""Claims jobs and sees them through: campaigns on the hub, analyses in processes of their own."""

import contextlib
import time
from collections import deque
from collections.abc import Callable
from queue import Empty

import structlog

from eigenfail.contracts import Store
from eigenfail.errors import ClaimLost, Conflict, IllegalTransition, InputError, NotFound
from eigenfail.values import FINAL_STATES, Campaign, CampaignState
from eigenfail.values.records import Job, JobKind
from eigenfail_services.campaigns.analysis_jobs import AnalysisJobs
from eigenfail_services.campaigns.materials import learner_context
from eigenfail_services.campaigns.owner import is_lost, this_process
from eigenfail_services.campaigns.unlisted import may_run
from eigenfail_services.campaigns.watch import Watch, spent
from eigenfail_services.hub.ended import Ended
from eigenfail_services.hub.runs import Order
from eigenfail_services.hub.server import Hub

LEASE_S = 10.0
RENEW_S = 2.0
ROOM = {JobKind.CAMPAIGN: 4, JobKind.ANALYSIS: 2}
"""How many at a time unless told otherwise; analyses never wait for campaigns."""

AT_REST = FINAL_STATES | {CampaignState.PAUSED}

log = structlog.get_logger()


class Supervisor:
    """One turn after the other: claim, tend, conclude.

    Args:
        store: where the queue is.
        hub: runs campaigns.
        analyses: runs analyses.
        campaigns: how many campaigns run at a time, each with a learner of its own.
    """

    def __init__(
        self,
        store: Store,
        hub: Hub,
        analyses: AnalysisJobs,
        campaigns: int = ROOM[JobKind.CAMPAIGN],
    ) -> None:
        self._room = ROOM | {JobKind.CAMPAIGN: campaigns}
        self._store = store
        self._hub = hub
        self._analyses = analyses
        self._owner = this_process()
        self._watched: dict[int, Watch] = {}
        self._to_close: deque[Ended] = deque()
        self._next_renewal_s = 0.0
        self._openers: dict[JobKind, Callable[[Job], None]] = {
            JobKind.CAMPAIGN: self._open_campaign,
            JobKind.ANALYSIS: analyses.open,
        }
        # What a user asked for while the campaign ran, and where it stands when that is done.
        self._wishes = {
            CampaignState.PAUSING: CampaignState.PAUSED,
            CampaignState.CANCELLING: CampaignState.CANCELLED,
        }

    def turn(self) -> None:
        """Do what is to be done now; never waits.

        Raises:
            StoreUnavailable: the database does not answer; the next turn tries again.
        """
        self._renew()
        self._claim()
        self._heed_wishes_and_rules()
        self._conclude()
        self._analyses.tend()

    def release(self) -> None:
        """Give back what is running, for the next supervisor to go on with."""
        for watch in self._watched.values():
            with contextlib.suppress(ClaimLost):
                watch.bill(self._store)
                self._store.jobs.renew(watch.job, 0.0)
        self._watched.clear()

    def _claim(self) -> None:
        for kind, opener in self._openers.items():
            while self._has_room(kind) and self._store.jobs.waiting(kind):
                job = self._store.jobs.claim(self._owner, LEASE_S, kind)
                if job is None:  # somebody else is at what waits: just claiming it, or lost while
                    break  # they wrote with its claim
                opener(job)

    def _has_room(self, kind: JobKind) -> bool:
        """Whether there is time for one more; looked at before the queue is locked for a claim."""
        running = {JobKind.CAMPAIGN: len(self._watched), JobKind.ANALYSIS: len(self._analyses)}
        return running[kind] < self._room[kind]

    def _open_campaign(self, job: Job) -> None:
        campaign = self._store.campaigns.get(job.subject)
        if watch := self._watched.get(job.subject):
            watch.claim_again(job, campaign)  # held up for so long that our own lease ran out
            return
        if campaign.state in AT_REST:
            self._store.jobs.finish(job)
            return
        if not may_run(campaign, job, self._store):
            return
        if campaign.state is not CampaignState.QUEUED:
            self._launch(campaign, job)
            return
        try:
            moved = self._store.campaigns.move(campaign.id, CampaignState.RUNNING, claim=job)
        except (IllegalTransition, ClaimLost):  # somebody paused or cancelled it since we looked
            self._store.jobs.finish(job)
            return
        self._launch(moved, job)

    def _launch(self, campaign: Campaign, job: Job) -> None:
        spec = campaign.spec
        try:
            context = learner_context(campaign, self._store)
        except (InputError, NotFound, Conflict) as error:
            with contextlib.suppress(ClaimLost):
                self._store.campaigns.move(campaign.id, CampaignState.DEAD, str(error), job)
            self._store.jobs.finish(job)
            return
        watch = self._watched[campaign.id] = Watch(job, spec.priority, campaign.active_s)
        order = Order(
            campaign=campaign.id,
            setup=spec.setup(),
            method=spec.method,
            settings=spec.settings,
            seed=spec.seed,
            context=context,
            rules=spec.stop,
            weight=spec.priority.weight,
            meter=watch.meter,
            claim=lambda: watch.job,
        )
        self._hub.launch(order)
        log.info("campaign started", campaign=campaign.id, method=spec.method)

    def _heed_wishes_and_rules(self) -> None:
        for campaign, watch in self._watched.items():
            if watch.halting:
                continue
            now = watch.so_far(self._store.campaigns.get(campaign))
            if watch.has_new(now.spec.priority):
                self._hub.weigh(campaign, now.spec.priority.weight)
            watch.spent = spent(now)
            if watch.spent or now.state in self._wishes:
                watch.halting = True
                self._hub.halt(campaign)

    def _renew(self) -> None:
        if time.monotonic() < self._next_renewal_s:
            return
        self._next_renewal_s = time.monotonic() + RENEW_S
        if freed := self._store.jobs.let_go(is_lost):
            log.info("took over from a lost process", jobs=freed)
        for watch in self._watched.values():  # all of them before anything that may take its time
            watch.lost = not self._store.jobs.renew(watch.job, LEASE_S)
        for campaign, watch in self._watched.items():
            if watch.lost or not watch.billed(self._store):
                watch.lost = True
                self._hub.halt(campaign)
            else:
                self._tell_progress(campaign, watch)

    def _tell_progress(self, campaign: int, watch: Watch) -> None:
        """Wake those who follow, if there is anything new to see."""
        counts = self._store.campaigns.get(campaign).counts
        if counts != watch.told:
            watch.told = counts
            finished = counts.completed + counts.failed
            progress = f"{finished} of {counts.planned} episodes, {counts.failures} failures."
            self._store.events.append("campaign.progress", progress, campaign)

    def _conclude(self) -> None:
        """Close what the hub has ended; what the store refuses now is closed in a later turn."""
        with contextlib.suppress(Empty):
            while True:
                self._to_close.append(self._hub.ended.get_nowait())
        while self._to_close:
            try:
                self._close_campaign(self._to_close[0])
            except IllegalTransition:  # a user asked for something else since we looked
                return
            self._to_close.popleft()

    def _close_campaign(self, ended: Ended) -> None:
        watch = self._watched[ended.campaign]
        if watch.lost or ended.lost or not self._settled(ended, watch):
            log.warning("campaign lost to another supervisor", campaign=ended.campaign)
            # It may have come back to us meanwhile: then it is launched anew.
            self._store.jobs.renew(watch.job, 0.0)
        del self._watched[ended.campaign]

    def _settled(self, ended: Ended, watch: Watch) -> bool:
        """Whether its end was ours to write down."""
        try:
            watch.bill(self._store)
            self._settle(ended, watch)
        except ClaimLost:
            return False
        self._store.jobs.finish(watch.job)
        return True

    def _settle(self, ended: Ended, watch: Watch) -> None:
        state = self._store.campaigns.get(ended.campaign).state
        if state in AT_REST:
            return
        to, because = self._verdict(state, watch, ended)
        self._store.campaigns.move(ended.campaign, to, because, watch.job)
        log.info("campaign ended", campaign=ended.campaign, state=to, because=because)

    def _verdict(
        self, state: CampaignState, watch: Watch, ended: Ended
    ) -> tuple[CampaignState, str]:
        if ended.problem:
            return CampaignState.DEAD, ended.problem
        if watch.halting and not watch.spent:
            return self._wishes[state], "A user asked for it."
        return CampaignState.DONE, ended.because or watch.spent
