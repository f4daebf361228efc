"""Claims jobs and runs them: campaigns on the hub, analyses in separate processes.

The owner of a job is a process with a name that is never reused. Only the owner's machine can see
that the owner has died; elsewhere only the lease of the job shows it.
"""

import contextlib
import os
import platform
import time
from collections import deque
from collections.abc import Callable
from math import isclose
from pathlib import Path
from queue import Empty
from typing import NamedTuple
from uuid import uuid4

import psutil
import structlog
from msgspec.structs import replace

from eigenfail import errors
from eigenfail.methods import traits_of
from eigenfail.values.campaign import FINAL_STATES, Campaign, CampaignState, Counts, Overhead
from eigenfail.values.campaign_spec import Priority
from eigenfail.values.records import Job, JobKind
from eigenfail.versions import learner_versions
from eigenfail.worlds import world_of
from eigenfail_services.campaigns import rounds
from eigenfail_services.campaigns.analysis_jobs import AnalysisJobs
from eigenfail_services.campaigns.references import learner_context
from eigenfail_services.campaigns.summary import find_cost
from eigenfail_services.hub.metrics import TimeAccounting
from eigenfail_services.hub.runs import RunSpec
from eigenfail_services.hub.server import FinishedRun, Hub
from eigenfail_services.store.lifecycle import BY_USER
from eigenfail_services.store.store import Store

PROCESSES = Path("/proc")
ZOMBIE = "Z"
NOWHERE = uuid4().hex


class ProcessFacts(NamedTuple):
    """A process: its state, and its start time after the start of the machine."""

    state: str
    started: str


def name_this_process() -> str:
    """Return the owner's name of this process."""
    life = read_process(os.getpid())
    return f"{find_place()}:{os.getpid()}:{life.started if life else ''}"


def is_lost(owner: str) -> bool:
    """Return whether an owner was a process on this machine that has ended."""
    where, _, rest = owner.partition(":")
    pid, _, started = rest.partition(":")
    if where != find_place() or not (pid.isdecimal() and started):
        return False
    life = read_process(int(pid))
    if life is None:  # another user's process may be hidden
        return not psutil.pid_exists(int(pid))
    return life.state == ZOMBIE or life.started != started


def find_place() -> str:
    """Return the name of this machine since its last start, and of its process namespace.

    Two containers may have one name; a restarted machine reuses process numbers. If the kernel does
    not report it, the name is this process's own, so that no other process shares it.
    """
    try:
        boot = (PROCESSES / "sys/kernel/random/boot_id").read_text("utf-8").strip()
        space = (PROCESSES / "self/ns/pid").stat().st_ino
    except OSError:
        return f"{platform.node()}/{NOWHERE}".replace(":", "_")
    return f"{platform.node()}/{boot}/{space}".replace(":", "_")


def read_process(pid: int) -> ProcessFacts | None:
    """Return state and start time of a process; None if it does not exist."""
    try:
        text = (PROCESSES / str(pid) / "stat").read_text("utf-8", "replace")
    except OSError:
        return None
    # The name of the program is in brackets, and may hold spaces and brackets of its own.
    fields = text.rpartition(")")[2].split()
    return ProcessFacts(fields[0], fields[19])


class Bill(NamedTuple):
    """The time between two readings of the clock, and the overhead in it. [s]"""

    since_s: float
    until_s: float
    overhead: Overhead

    @property
    def length_s(self) -> float:
        """Return the time that the bill adds to the campaign's active time. [s]"""
        return self.until_s - self.since_s


class SupervisedCampaign:
    """A campaign that runs on this hub, the claimed job, and the time that is billed.

    Args:
        job: our claim; no other supervisor bills the campaign as long as it holds.
        priority: the priority last sent to the hub.
        kept_s: the campaign's active time as the store has it.
    """

    def __init__(self, job: Job, priority: Priority = Priority.NORMAL, kept_s: float = 0.0) -> None:
        self.job = job
        self.priority = priority
        self.accounting = TimeAccounting()
        self._kept_s = kept_s
        self._billed_s = time.monotonic()
        self._unanswered: Bill | None = None
        self.sent_counts: Counts | None = None
        self.halting = False
        self.lost = False
        self.rule_held = ""

    def has_new(self, priority: Priority) -> bool:
        """Set the priority, and return whether it has changed."""
        before, self.priority = self.priority, priority
        return before is not priority

    def so_far(self, campaign: Campaign) -> Campaign:
        """Return the campaign with the time that is not yet billed."""
        unbilled_s = time.monotonic() - self._billed_s
        return replace(campaign, active_s=self._kept_s + unbilled_s)

    def billed(self, store: Store) -> bool:
        """Bill the time until now; return False if another supervisor has claimed the campaign."""
        try:
            self.bill(store)
        except errors.ClaimLost:
            return False
        return True

    def bill(self, store: Store) -> None:
        """Add the time since the last bill; it stays open while the store is away.

        Raises:
            StoreUnavailable: it could not be added.
            ClaimLost: another supervisor has claimed the campaign, and bills its time.
        """
        self._look_up(store)
        # Taken before the clock is read, so that no part is more than the whole.
        overhead = self.accounting.take()
        bill = self._unanswered = Bill(self._billed_s, time.monotonic(), overhead)
        store.campaigns.add_active(self.job.subject, bill.length_s, overhead, self.job)
        self._keep(bill)

    def claim_again(self, job: Job, campaign: Campaign) -> None:
        """Go on with a new claim; another supervisor may have billed time in between.

        Args:
            job: our new claim.
            campaign: as the store has it.
        """
        if bill := self._unanswered:
            # Another supervisor may have billed any time in between: only exactly this sum shows
            # that ours was kept.
            if isclose(campaign.active_s, self._kept_s + bill.length_s):
                self._keep(bill)
            else:
                self._forget(bill)
        self.job, self._kept_s = job, campaign.active_s

    def _look_up(self, store: Store) -> None:
        """Find out from the campaign's stored time whether an unanswered bill was kept."""
        if (bill := self._unanswered) is None:
            return
        kept_s = store.campaigns.get(self.job.subject).active_s
        # The store has kept all of the bill or nothing: halfway between, rounding cannot decide.
        if kept_s > self._kept_s + bill.length_s / 2:
            self._keep(bill)
        else:
            self._forget(bill)

    def _forget(self, bill: Bill) -> None:
        self.accounting.give_back(bill.overhead)
        self._unanswered = None

    def _keep(self, bill: Bill) -> None:
        self._kept_s += bill.length_s
        self._billed_s, self._unanswered = bill.until_s, None


def find_spent_rule(campaign: Campaign) -> str:
    """Return which rule on time or cost ends the campaign; empty if none does."""
    return rounds.judge_time(campaign.spec.stop, campaign.active_s, find_cost(campaign).total_usd)


# A lease is as long as five renewals: a turn that takes some seconds loses no campaign.
LEASE_S = 10.0
RENEW_S = 2.0
ROOM = {JobKind.CAMPAIGN: 4, JobKind.ANALYSIS: 2}
"""Default number of analyses at a time; analyses never wait for campaigns."""

AT_REST = FINAL_STATES | {CampaignState.PAUSED}

log = structlog.get_logger()


AFTER = {
    CampaignState.PAUSING: CampaignState.PAUSED,
    CampaignState.CANCELLING: CampaignState.CANCELLED,
}
"""State of a campaign after a user's request has taken effect, by the state that requests it."""


def may_run(campaign: Campaign, job: Job, store: Store) -> bool:
    """Return whether a claimed campaign may run here; one that may not is paused."""
    try:
        world_of(campaign.spec.simulator).refuse_unlisted(campaign.spec.planner)
    except errors.InvalidValue as error:
        _set_aside(campaign, job, store, f"{error} Then: eigenfail campaign resume {campaign.id}.")
        return False
    return True


def set_aside_declined(campaign: Campaign, job: Job, store: Store, reason: str) -> None:
    """Pause a campaign that a worker cannot run, with the reason and the remedy."""
    remedy = (
        f"Launch a corrected one: eigenfail campaign clone {campaign.id} --set FIELD=VALUE. If the "
        f"worker or its bridge is to blame, mend it, then: eigenfail campaign resume {campaign.id}."
    )
    _set_aside(campaign, job, store, f"{reason} {remedy}")


def _set_aside(campaign: Campaign, job: Job, store: Store, because: str) -> None:
    """Pause a campaign, or cancel it if a user asked for that.

    In the queue it would be claimed again and again, until it counts as dead.
    """
    move, state = store.campaigns.move, campaign.state
    try:
        if state is CampaignState.RUNNING:
            state = move(campaign.id, CampaignState.PAUSING, because, job).state
        move(campaign.id, AFTER.get(state, CampaignState.PAUSED), because, job)
    except (
        errors.IllegalTransition,
        errors.ClaimLost,
    ):  # a user has asked for something else meanwhile
        # The job is free at once, and its next claim reads the new state.
        store.jobs.renew(job, 0.0)
        return
    store.jobs.finish(job)


class Supervisor:
    """Claims jobs, polls running ones and concludes ended ones, turn by turn.

    Args:
        store: store with the queue.
        hub: runs campaigns.
        analyses: runs analyses.
        campaigns: how many campaigns run at a time, each with its own learner.
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
        self._owner = name_this_process()
        self._watched: dict[int, SupervisedCampaign] = {}
        self._to_close: deque[FinishedRun] = deque()
        self._next_renewal_s = 0.0
        self._openers: dict[JobKind, Callable[[Job], None]] = {
            JobKind.CAMPAIGN: self._open_campaign,
            JobKind.ANALYSIS: analyses.open,
        }

    def turn(self) -> None:
        """Renew, claim, halt and conclude whatever is due now, without waiting.

        Raises:
            StoreUnavailable: the database does not answer; the next turn tries again.
        """
        # Renewals come first: whatever else takes long in a turn, the campaigns stay ours.
        self._renew()
        self._claim()
        self._heed_wishes_and_rules()
        self._conclude()
        self._analyses.poll()

    def release(self) -> None:
        """Release the claims of all running campaigns for the next supervisor."""
        for watch in self._watched.values():
            with contextlib.suppress(errors.ClaimLost):
                watch.bill(self._store)
                self._store.jobs.renew(watch.job, 0.0)
        self._watched.clear()

    def _claim(self) -> None:
        for kind, opener in self._openers.items():
            # The queue is read before it is claimed from: a claim is a write, for which other
            # writers wait.
            while self._has_room(kind) and self._store.jobs.waiting(kind):
                job = self._store.jobs.claim(self._owner, LEASE_S, kind)
                # Another supervisor is claiming what waits, or was lost while it wrote its claim.
                if job is None:
                    break
                opener(job)

    def _has_room(self, kind: JobKind) -> bool:
        """Return whether one more job may run; asked before the queue is locked for a claim."""
        running = {JobKind.CAMPAIGN: len(self._watched), JobKind.ANALYSIS: len(self._analyses)}
        return running[kind] < self._room[kind]

    def _open_campaign(self, job: Job) -> None:
        campaign = self._store.campaigns.get(job.subject)
        if watch := self._watched.get(job.subject):
            watch.claim_again(job, campaign)  # held up for so long that our own lease ran out
            return
        # A service that was killed between the end of a campaign and the removal of its job left
        # the job.
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
        except (
            errors.IllegalTransition,
            errors.ClaimLost,
        ):  # a user has paused or cancelled it meanwhile
            self._store.jobs.finish(job)
            return
        self._launch(moved, job)

    def _launch(self, campaign: Campaign, job: Job) -> None:
        spec = campaign.spec
        try:
            context = learner_context(campaign, self._store)
        except (errors.InputError, errors.NotFound, errors.Conflict) as error:
            with contextlib.suppress(errors.ClaimLost):
                self._store.campaigns.move(campaign.id, CampaignState.DEAD, str(error), job)
            self._store.jobs.finish(job)
            return
        # The versions are stored before an episode runs, so that no result has unknown versions.
        with contextlib.suppress(errors.ClaimLost):  # the new owner records its own versions
            self._store.campaigns.begin_part(campaign.id, learner_versions(), job)
        watch = self._watched[campaign.id] = SupervisedCampaign(
            job, spec.priority, campaign.active_s
        )
        run = RunSpec(
            campaign=campaign.id,
            setup=spec.setup(),
            method=spec.method,
            settings=spec.settings,
            seed=spec.seed,
            context=context,
            rules=spec.stop,
            weight=spec.priority.weight,
            observes=traits_of(spec.method).observes,
            accounting=watch.accounting,
            # A function, because a lease that was lost and claimed again has another token.
            claim=lambda: watch.job,
        )
        self._hub.launch(run)
        log.info("campaign started", campaign=campaign.id, method=spec.method)

    def _heed_wishes_and_rules(self) -> None:
        for campaign, watch in self._watched.items():
            if watch.halting:
                continue
            now = watch.so_far(self._store.campaigns.get(campaign))
            if watch.has_new(now.spec.priority):
                self._hub.set_weight(campaign, now.spec.priority.weight)
            watch.rule_held = find_spent_rule(now)
            if watch.rule_held or now.state in AFTER:
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

    def _tell_progress(self, campaign: int, watch: SupervisedCampaign) -> None:
        """Append a progress event if the counts have changed."""
        counts = self._store.campaigns.get(campaign).counts
        if counts != watch.sent_counts:
            watch.sent_counts = counts
            finished = counts.completed + counts.errored
            progress = f"{finished} of {counts.planned} episodes, {counts.failures} failures."
            self._store.events.append("campaign.progress", progress, campaign)

    def _conclude(self) -> None:
        """Close the campaigns that the hub has ended; a refused one is closed in a later turn."""
        with contextlib.suppress(Empty):
            while True:
                self._to_close.append(self._hub.finished_runs.get_nowait())
        while self._to_close:
            try:
                self._close_campaign(self._to_close[0])
            except errors.IllegalTransition:  # a user asked for something else since we looked
                return
            self._to_close.popleft()

    def _close_campaign(self, ended: FinishedRun) -> None:
        watch = self._watched[ended.campaign]
        if watch.lost or ended.lost or not self._settled(ended, watch):
            log.warning("campaign lost to another supervisor", campaign=ended.campaign)
            # It may have come back to us meanwhile: then it is launched anew.
            self._store.jobs.renew(watch.job, 0.0)
        del self._watched[ended.campaign]

    def _settled(self, ended: FinishedRun, watch: SupervisedCampaign) -> bool:
        """Store the end of a campaign; return False if another supervisor has claimed it."""
        try:
            watch.bill(self._store)
            if ended.declined:
                seen = self._store.campaigns.get(ended.campaign)
                set_aside_declined(seen, watch.job, self._store, ended.declined)
                return True
            self._settle(ended, watch)
        except errors.ClaimLost:
            return False
        # The job is removed last: after a crash in between, its next claim finds the campaign at
        # rest and removes the job.
        self._store.jobs.finish(watch.job)
        return True

    def _settle(self, ended: FinishedRun, watch: SupervisedCampaign) -> None:
        state = self._store.campaigns.get(ended.campaign).state
        if state in AT_REST:
            return
        to, because = self._verdict(state, watch, ended)
        self._store.campaigns.move(ended.campaign, to, because, watch.job)
        log.info("campaign ended", campaign=ended.campaign, state=to, because=because)

    def _verdict(
        self, state: CampaignState, watch: SupervisedCampaign, ended: FinishedRun
    ) -> tuple[CampaignState, str]:
        if ended.problem:
            return CampaignState.DEAD, ended.problem
        # A rule on time or cost halts a campaign as well, and ends it as planned: done, not
        # cancelled.
        if watch.halting and not watch.rule_held:
            return AFTER[state], BY_USER
        return CampaignState.DONE, ended.stopped_because or watch.rule_held
