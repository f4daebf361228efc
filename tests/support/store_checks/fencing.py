"""Checks of what only the holder of a campaign's claim may write."""

from threading import Thread

from eigenfail.errors import ClaimLost
from eigenfail.testing import expect, expect_error
from eigenfail.values.campaign import Campaign, CampaignState, Overhead
from eigenfail.values.estimates import Estimate
from eigenfail.values.records import Job
from eigenfail_services.store.store import Store
from store_checks.examples import equal, running
from store_checks.jobs import LONG_S, PASSED_S, PATIENCE_S, claimed, waited_for

TOLD = Estimate(by="importance sampling", episodes=7, problem="Too few count.")


def taken_over(store: Store) -> tuple[Campaign, Job, Job]:
    """A campaign that runs, the claim of who was held up, and that of who took over."""
    campaign = running(store)
    return campaign, claimed(store, PASSED_S), claimed(store)


def saves_checkpoints_of_the_holder_alone(store: Store) -> None:
    """Who was held up and wakes cannot put an older checkpoint over a newer one."""
    campaign, old, new = taken_over(store)
    store.checkpoints.save(campaign.id, b"new", TOLD, 170, new)
    with expect_error(ClaimLost, "A checkpoint was saved under a lost claim."):
        store.checkpoints.save(campaign.id, b"old", None, 3, old)
    with expect_error(ClaimLost, "A checkpoint was recovered under a lost claim."):
        store.checkpoints.recover(campaign.id, old)
    found = store.campaigns.get(campaign.id)
    equal((found.estimate, found.trained_episodes), (TOLD, 170), "What the learner told")
    equal(store.checkpoints.load(campaign.id), b"new", "The checkpoint")
    equal(store.checkpoints.recover(campaign.id, new), b"new", "The checkpoint to go on from")


def moves_campaigns_of_the_holder_alone(store: Store) -> None:
    """Who was held up ends nothing; users, who have no claim, steer as ever."""
    campaign, old, new = taken_over(store)
    before = store.events.last()
    for state in (CampaignState.DONE, CampaignState.DEAD, CampaignState.RUNNING):
        with expect_error(ClaimLost, f"A campaign became {state} under a lost claim."):
            store.campaigns.move(campaign.id, state, "It diverged.", old)
    equal(store.campaigns.get(campaign.id), campaign, "The campaign")
    equal(store.events.last(), before, "The newest event")
    store.campaigns.move(campaign.id, CampaignState.PAUSING)
    paused = store.campaigns.move(campaign.id, CampaignState.PAUSED, "Requested by a user.", new)
    equal(paused.state, CampaignState.PAUSED, "The state after the holder's move")


def bills_the_holders_time_alone(store: Store) -> None:
    """The same time is not billed twice, by two who run one campaign."""
    campaign, old, new = taken_over(store)
    store.campaigns.add_active(campaign.id, 2.0, Overhead(learning_s=1.0), new)
    with expect_error(ClaimLost, "Time was billed under a lost claim."):
        store.campaigns.add_active(campaign.id, 5.0, Overhead(learning_s=5.0), old)
    found = store.campaigns.get(campaign.id)
    equal((found.active_s, found.overhead), (2.0, Overhead(learning_s=1.0)), "What was billed")


def a_lease_that_nobody_took_up_is_still_a_claim(store: Store) -> None:
    """Only another claim takes a campaign away, not the time alone."""
    campaign, claim = running(store), claimed(store, PASSED_S)
    store.checkpoints.save(campaign.id, b"state", claim=claim)
    store.campaigns.add_active(campaign.id, 2.0, claim=claim)
    done = store.campaigns.move(campaign.id, CampaignState.DONE, claim=claim)
    equal(done.state, CampaignState.DONE, "The state")


def what_ended_or_was_resumed_is_nobodys(store: Store) -> None:
    """A job that was finished is no claim, nor is one of a campaign's earlier life."""
    finished, campaign = running(store), running(store)
    claim = claimed(store)
    expect(store.jobs.finish(claim), "A job could not be finished.")
    with expect_error(ClaimLost, "A checkpoint was saved under a finished claim."):
        store.checkpoints.save(finished.id, b"old", claim=claim)
    earlier = claimed(store)
    for state in (CampaignState.PAUSING, CampaignState.PAUSED, CampaignState.QUEUED):
        store.campaigns.move(campaign.id, state)
    with expect_error(ClaimLost, "A campaign ran on under the claim of an earlier life."):
        store.campaigns.move(campaign.id, CampaignState.RUNNING, claim=earlier)


def a_takeover_ends_the_writing_at_once(store: Store) -> None:
    """While one writes as fast as it can, another takes over: not one write comes after that."""
    campaign, old = running(store), claimed(store, PASSED_S)
    writer = Thread(target=until_lost, args=(store, campaign.id, old), daemon=True)
    writer.start()
    new = waited_for(store)
    store.checkpoints.save(campaign.id, b"new", claim=new)
    writer.join(PATIENCE_S)
    expect(not writer.is_alive(), "Who lost the campaign never learnt of it.")
    equal(store.checkpoints.load(campaign.id), b"new", "The checkpoint")
    expect(store.jobs.renew(new, LONG_S), "Who took over could not renew.")


def until_lost(store: Store, campaign: int, claim: Job) -> None:
    """Save one checkpoint after the other until somebody else has the campaign."""
    try:
        while True:
            store.checkpoints.save(campaign, b"old", claim=claim)
    except ClaimLost:
        return
