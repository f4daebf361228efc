"""Checks of `JobQueue`."""

import time

import deadlines
from accepted import accept_spec

from eigenfail.testing import expect
from eigenfail.testing.examples import spec
from eigenfail.values.analysis import AnalysisSettings, AnalysisState
from eigenfail.values.campaign import CampaignState
from eigenfail.values.records import Job, JobKind
from eigenfail_services.store.store import Store
from store_checks.examples import equal, running

LONG_S, SHORT_S, PATIENCE_S = 600.0, 0.05, deadlines.PROCESS_S
PASSED_S = 0.0
"""A lease that is over as soon as it begins."""

MAX_ATTEMPTS = 5


def claimed(store: Store, lease_s: float = LONG_S) -> Job:
    """A job; there must be one."""
    job = store.jobs.claim("somebody", lease_s)
    if job is None:
        raise AssertionError("There was nothing to claim.")
    return job


def claims_by_kind(store: Store) -> None:
    """Whoever has time for one kind only is given that kind, however long others have waited."""
    campaign = store.campaigns.create(accept_spec(spec())).id
    analysis = store.analyses.create(campaign, AnalysisSettings()).id
    job = store.jobs.claim("a", LONG_S, JobKind.ANALYSIS)
    equal(job and job.subject, analysis, "The analysis, though the campaign is older")
    equal(store.jobs.claim("a", LONG_S, JobKind.ANALYSIS), None, "No other analysis")


def lets_go_of_what_the_lost_held(store: Store) -> None:
    """Only theirs, and only once; whoever was lost cannot hold it any more after the next claim."""
    for _ in range(3):
        store.campaigns.create(accept_spec(spec()))
    first, second = (store.jobs.claim(name, LONG_S) for name in ("lost", "well"))
    equal(store.jobs.let_go(lambda owner: owner == "lost"), 1, "Jobs of the lost")
    equal(store.jobs.let_go(lambda owner: owner == "lost"), 0, "The same a second time")
    again = claimed(store)
    equal(first and first.id, again.id, "What is claimed next")
    expect(first is not None and not store.jobs.renew(first, LONG_S), "The lost hold it still.")
    expect(second is not None and store.jobs.renew(second, LONG_S), "The others lost theirs.")
    equal(store.jobs.waiting(JobKind.CAMPAIGN), 1, "Campaigns that nobody ever claimed")


def waited_for(store: Store) -> Job:
    """The next job that can be claimed, as soon as there is one.

    Only its being there counts, not when: on a busy machine any wait may be longer than a lease.
    """
    until_s = time.monotonic() + PATIENCE_S
    while (job := store.jobs.claim("b", LONG_S)) is None:
        expect(time.monotonic() < until_s, "A lease that was over did not end.")
        time.sleep(SHORT_S / 5)
    return job


def buries_what_never_gets_on(store: Store) -> None:
    """After five lost claims the campaign is dead, says why, and the queue moves on."""
    campaign = store.campaigns.create(accept_spec(spec()))
    behind = store.campaigns.create(accept_spec(spec()))
    for attempt in range(1, MAX_ATTEMPTS + 1):
        job = claimed(store, PASSED_S)
        equal((job.subject, job.attempts), (campaign.id, attempt), "Each attempt")
    equal(claimed(store).subject, behind.id, "The job behind the buried one")
    dead = store.campaigns.get(campaign.id)
    equal((dead.state, dead.counts.open), (CampaignState.DEAD, 0), "The campaign")
    expect(str(MAX_ATTEMPTS) in dead.stopped_because, f"It says: {dead.stopped_because!r}.")
    expect(not store.jobs.renew(job, LONG_S), "A buried job was renewed.")
    equal(store.jobs.waiting(JobKind.CAMPAIGN), 0, "Jobs that wait after a burial")


def buries_analyses(store: Store) -> None:
    """The same for an analysis: it failed, and says why."""
    campaign = running(store)
    expect(store.jobs.finish(claimed(store)), "A job could not be finished.")
    analysis = store.analyses.create(campaign.id, AnalysisSettings())
    for _ in range(MAX_ATTEMPTS):
        claimed(store, PASSED_S)
    equal(store.jobs.claim("a", LONG_S), None, "A claim on the buried job")
    failed = store.analyses.get(analysis.id)
    equal(failed.state, AnalysisState.FAILED, "The analysis")
    expect(bool(failed.problem), "A buried analysis does not say why.")


def burying_spares_the_ended(store: Store) -> None:
    """A job that was left over from a campaign that ended changes nothing in it."""
    done = store.campaigns.move(running(store).id, CampaignState.DONE)
    for _ in range(MAX_ATTEMPTS):
        claimed(store, PASSED_S)
    equal(store.jobs.claim("a", LONG_S), None, "A claim on the buried job")
    equal(store.campaigns.get(done.id), done, "The campaign")


def counts_the_waiting(store: Store) -> None:
    """Leased and finished jobs do not wait."""
    campaign = store.campaigns.create(accept_spec(spec()))
    store.campaigns.create(accept_spec(spec()))
    store.analyses.create(campaign.id, AnalysisSettings())
    equal(store.jobs.waiting(JobKind.CAMPAIGN), 2, "Campaigns that wait")
    equal(store.jobs.waiting(JobKind.ANALYSIS), 1, "Analyses that wait")
    job = claimed(store)
    equal(store.jobs.waiting(JobKind.CAMPAIGN), 1, "Campaigns that wait after a claim")
    expect(store.jobs.finish(job), "A held job could not be finished.")
    equal(store.jobs.waiting(JobKind.CAMPAIGN), 1, "Campaigns that wait after an end")


def requeueing_takes_the_job_away(store: Store) -> None:
    """Who held the job of a campaign that was paused and resumed holds it no more."""
    campaign = running(store)
    job = claimed(store)
    for state in (CampaignState.PAUSING, CampaignState.PAUSED, CampaignState.QUEUED):
        store.campaigns.move(campaign.id, state)
    expect(not store.jobs.renew(job, LONG_S), "The old holder renewed a job of the new life.")
    expect(not store.jobs.finish(job), "The old holder finished a job of the new life.")
    again = claimed(store)
    equal((again.subject, again.attempts), (campaign.id, 1), "The job of the new life")
