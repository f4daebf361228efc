"""Checks of `JobQueue`."""

import time

import deadlines
from accepted import accept_spec

from eigenfail.testing import expect
from eigenfail.testing.examples import result, spec
from eigenfail.values.analysis import AnalysisSettings, AnalysisState
from eigenfail.values.campaign import CampaignState
from eigenfail.values.records import Job, JobKind
from eigenfail_services.store.store import Store
from store_checks.examples import deliver, equal, running

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


def claims_the_oldest(store: Store) -> None:
    """First come, first served; what is leased is nobody else's."""
    equal(store.jobs.claim("a", LONG_S), None, "A claim on an empty queue")
    campaigns = [store.campaigns.create(accept_spec(spec())).id for _ in range(2)]
    analysis = store.analyses.create(campaigns[0], AnalysisSettings()).id
    jobs = [claimed(store) for _ in range(3)]
    wanted = [(JobKind.CAMPAIGN, number) for number in campaigns] + [(JobKind.ANALYSIS, analysis)]
    equal([(job.kind, job.subject) for job in jobs], wanted, "Jobs in the order of their coming")
    equal({job.attempts for job in jobs}, {1}, "Attempts at a first claim")
    equal(store.jobs.claim("a", LONG_S), None, "A claim when everything is leased")


def claims_by_kind(store: Store) -> None:
    """Whoever has time for one kind only is given that kind, however long others have waited."""
    campaign = store.campaigns.create(accept_spec(spec())).id
    analysis = store.analyses.create(campaign, AnalysisSettings()).id
    job = store.jobs.claim("a", LONG_S, JobKind.ANALYSIS)
    equal(job and job.subject, analysis, "The analysis, though the campaign is older")
    equal(store.jobs.claim("a", LONG_S, JobKind.ANALYSIS), None, "No other analysis")


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


def finishes_for_good(store: Store) -> None:
    """A finished job never comes back, and is finished once."""
    store.campaigns.create(accept_spec(spec()))
    job = claimed(store, PASSED_S)
    expect(store.jobs.finish(job), "A job could not be finished.")
    expect(not store.jobs.finish(job), "A job was finished twice.")
    expect(not store.jobs.renew(job, LONG_S), "A finished job was renewed.")
    equal(store.jobs.claim("a", LONG_S), None, "A claim after the end")


def leases_run_out(store: Store) -> None:
    """A job whose lease is over goes to the next; the token tells the two apart."""
    held, lost = (store.campaigns.create(accept_spec(spec())).id for _ in range(2))
    equal(claimed(store).subject, held, "The job with the long lease")
    first = claimed(store, SHORT_S)
    equal(first.subject, lost, "The job with the short lease")
    second = waited_for(store)
    equal((second.id, second.attempts), (first.id, 2), "The job after its lease")
    expect(second.token != first.token, "Two claims have one token.")
    expect(not store.jobs.renew(first, LONG_S), "The first holder renewed what it had lost.")
    expect(not store.jobs.finish(first), "The first holder finished what it had lost.")
    expect(store.jobs.finish(second), "The second holder could not finish.")
    equal(store.jobs.claim("a", LONG_S), None, "A claim while the other lease lasts")


def waited_for(store: Store) -> Job:
    """The next job that can be claimed, as soon as there is one.

    Only its being there counts, not when: on a busy machine any wait may be longer than a lease.
    """
    until_s = time.monotonic() + PATIENCE_S
    while (job := store.jobs.claim("b", LONG_S)) is None:
        expect(time.monotonic() < until_s, "A lease that was over did not end.")
        time.sleep(SHORT_S / 5)
    return job


def renewing_holds(store: Store) -> None:
    """A renewed job stays, even if its lease had run out unnoticed."""
    store.campaigns.create(accept_spec(spec()))
    job = claimed(store, PASSED_S)
    expect(store.jobs.renew(job, LONG_S), "A job could not be renewed.")
    equal(store.jobs.claim("a", LONG_S), None, "A claim after a renewal")


def renewing_for_nothing_gives_back(store: Store) -> None:
    """A renewal for 0 s hands the job to whoever asks next."""
    store.campaigns.create(accept_spec(spec()))
    job = claimed(store)
    expect(store.jobs.renew(job, 0.0), "A job could not be given back.")
    equal(claimed(store).id, job.id, "The job that was given back")


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


def spares_what_gets_on(store: Store) -> None:
    """Losing a supervisor is no reason to give up a campaign that keeps results."""
    campaign = running(store)
    for index in range(2 * MAX_ATTEMPTS):
        equal(claimed(store, PASSED_S).attempts, 1, "Attempts of a campaign that gets on")
        deliver(store, campaign, result(index))
    equal(store.campaigns.get(campaign.id).state, CampaignState.RUNNING, "The campaign")


def burying_spares_the_ended(store: Store) -> None:
    """A job that was left over from a campaign that ended changes nothing in it."""
    done = store.campaigns.move(running(store).id, CampaignState.DONE)
    for _ in range(MAX_ATTEMPTS):
        claimed(store, PASSED_S)
    equal(store.jobs.claim("a", LONG_S), None, "A claim on the buried job")
    equal(store.campaigns.get(done.id), done, "The campaign")


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


CHECKS = (
    claims_the_oldest,
    claims_by_kind,
    counts_the_waiting,
    finishes_for_good,
    lets_go_of_what_the_lost_held,
    leases_run_out,
    renewing_holds,
    renewing_for_nothing_gives_back,
    buries_what_never_gets_on,
    buries_analyses,
    spares_what_gets_on,
    burying_spares_the_ended,
    requeueing_takes_the_job_away,
)
