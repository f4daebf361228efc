"""Checks of `CampaignStore`."""

import time

from eigenfail.contracts import Store
from eigenfail.errors import IdempotencyMismatch, IllegalTransition, NotFound
from eigenfail.testing.expectations import expect, expect_error
from eigenfail.testing.store.examples import (
    BEYOND,
    collision,
    deliver,
    equal,
    failed,
    result,
    running,
    spec,
)
from eigenfail.values import FINAL_STATES, AnalysisSettings, Campaign, CampaignState, Counts
from eigenfail.values.records import JobKind

S = CampaignState

WAYS: dict[CampaignState, tuple[CampaignState, ...]] = {
    S.QUEUED: (),
    S.RUNNING: (S.RUNNING,),
    S.PAUSING: (S.RUNNING, S.PAUSING),
    S.PAUSED: (S.PAUSED,),
    S.CANCELLING: (S.RUNNING, S.CANCELLING),
    S.CANCELLED: (S.CANCELLED,),
    S.DONE: (S.RUNNING, S.DONE),
    S.DEAD: (S.RUNNING, S.DEAD),
}
"""How to get there."""

ALLOWED: dict[CampaignState, set[CampaignState]] = {
    S.QUEUED: {S.RUNNING, S.PAUSED, S.CANCELLED, S.DEAD, S.QUEUED},
    S.RUNNING: {S.PAUSING, S.CANCELLING, S.DONE, S.DEAD},
    S.PAUSING: {S.PAUSED, S.CANCELLING, S.RUNNING, S.DONE, S.DEAD, S.PAUSING},
    S.PAUSED: {S.QUEUED, S.CANCELLED, S.PAUSED},
    S.CANCELLING: {S.CANCELLED, S.DONE, S.DEAD, S.CANCELLING},
    S.CANCELLED: {S.CANCELLED},
    S.DONE: set(),
    S.DEAD: set(),
}
"""Where to go from there; what a user asks for may be asked twice."""


def in_state(store: Store, state: CampaignState) -> Campaign:
    """A new campaign, brought into a state."""
    campaign = store.campaigns.create(spec())
    for step in WAYS[state]:
        campaign = store.campaigns.move(campaign.id, step)
    return campaign


def creates_queued(store: Store) -> None:
    """A new campaign waits, with a job and an event that says so."""
    before_ms = time.time_ns() // 1_000_000
    campaign = store.campaigns.create(spec(name="first"))
    equal(campaign.state, S.QUEUED, "A new campaign's state")
    equal(campaign.counts, Counts(10), "A new campaign's counts")
    equal((campaign.started_ms, campaign.ended_ms), (None, None), "A new campaign's times")
    expect(0 <= campaign.created_ms - before_ms < 60_000, "created_ms is not the time of creation.")
    equal(store.campaigns.get(campaign.id), campaign, "The campaign that is read")
    equal(store.jobs.waiting(JobKind.CAMPAIGN), 1, "Jobs for one new campaign")
    (event,) = store.events.after(0, 10)
    equal((event.kind, event.campaign), ("campaign.created", campaign.id), "The event")
    expect("first" in event.message, "The event does not name the campaign.")


def keeps_specs_exactly(store: Store) -> None:
    """Whatever a spec holds comes back the same."""
    settings = {
        "rate": 0.1,
        "whole": 3,
        "nested": {"list": [1, 2.5, None, True]},
        "text": "σ'\"; --",
    }
    given = spec(name="Stau ✓", settings=settings, seed=2**63 - 1, price_usd_per_hour=1e-9)
    equal(store.campaigns.get(store.campaigns.create(given).id).spec, given, "The spec")


def repeats_a_key(store: Store) -> None:
    """One key, one campaign: the second request gets the first one's, as it stands by then."""
    first = store.campaigns.create(spec(), "key")
    store.campaigns.move(first.id, S.RUNNING)
    events, waiting = store.events.last(), store.jobs.waiting(JobKind.CAMPAIGN)
    again = store.campaigns.create(spec(), "key")
    equal((again.id, again.state), (first.id, S.RUNNING), "The campaign of a repeated key")
    equal(store.events.last(), events, "Events after a repeated key")
    equal(store.jobs.waiting(JobKind.CAMPAIGN), waiting, "Jobs after a repeated key")


def refuses_a_key_for_two_specs(store: Store) -> None:
    """A key stands for one request."""
    store.campaigns.create(spec(), "key")
    with expect_error(IdempotencyMismatch, "A key was accepted for another spec."):
        store.campaigns.create(spec(seed=1), "key")
    equal(len(store.campaigns.page(10).items), 1, "Campaigns after a refused key")


def tells_requests_apart(store: Store) -> None:
    """Without a key, and with different ones, the same spec makes new campaigns."""
    ids = [store.campaigns.create(spec(), key).id for key in (None, None, "a", "b")]
    equal(ids, sorted(set(ids)), "The ids of four campaigns")


def knows_no_strangers(store: Store) -> None:
    """An id that nothing has is NotFound, however odd it is."""
    store.campaigns.create(spec())
    for stranger in BEYOND:
        with expect_error(NotFound, f"get({stranger}) found something."):
            store.campaigns.get(stranger)
        with expect_error(NotFound, f"move({stranger}) moved something."):
            store.campaigns.move(stranger, S.RUNNING)
        with expect_error(NotFound, f"add_active({stranger}) went somewhere."):
            store.campaigns.add_active(stranger, 1.0)
        with expect_error(NotFound, f"commit({stranger}) kept something."):
            store.episodes.commit(stranger, [])
        with expect_error(NotFound, f"checkpoints.save({stranger}) kept something."):
            store.checkpoints.save(stranger, b"state")
        with expect_error(NotFound, f"analyses.create({stranger}) made something."):
            store.analyses.create(stranger, AnalysisSettings())


def pages_newest_first(store: Store) -> None:
    """Pages follow each other without gap or overlap, and end."""
    ids = [store.campaigns.create(spec()).id for _ in range(5)]
    seen, before = [], None
    for _ in range(3):
        page = store.campaigns.page(2, before)
        seen += [campaign.id for campaign in page.items]
        before = page.next
    equal(seen, ids[::-1], "Campaigns over three pages of two")
    equal(before, None, "The cursor of the last page")
    equal(store.campaigns.page(5).next, None, "The cursor of a page that holds just everything")
    equal(store.campaigns.page(5, before=2**70).items[0].id, ids[-1], "The first below 2**70")


def pages_one_state(store: Store) -> None:
    """Pages of one state leave out the others."""
    paused, _, also = (store.campaigns.create(spec()).id for _ in range(3))
    for campaign in (paused, also):
        store.campaigns.move(campaign, S.PAUSED)
    first = store.campaigns.page(1, state=S.PAUSED)
    second = store.campaigns.page(1, first.next, S.PAUSED)
    equal([c.id for c in (*first.items, *second.items)], [also, paused], "Paused campaigns")
    equal(second.next, None, "The cursor of the last page")


def moves_by_the_table(store: Store) -> None:
    """Every move of the table is made, every other refused without a trace."""
    for source in S:
        for target in S:
            campaign = in_state(store, source)
            events = store.events.last()
            if target in ALLOWED[source]:
                equal(store.campaigns.move(campaign.id, target).state, target, f"From {source}")
            else:
                with expect_error(IllegalTransition, f"{source} became {target}."):
                    store.campaigns.move(campaign.id, target)
            changed = target in ALLOWED[source] and target is not source
            after = store.campaigns.get(campaign.id)
            equal(after.state, target if changed else source, f"{source} after {target}")
            equal(store.events.last() - events, int(changed), f"Events of {source} to {target}")


def tells_of_moves(store: Store) -> None:
    """The event of a move names the campaign, the state and the reason."""
    campaign = running(store, name="first")
    store.campaigns.move(campaign.id, S.PAUSING, "A user asked for it.")
    event = store.events.after(0, 10)[-1]
    equal((event.kind, event.campaign), ("campaign.state", campaign.id), "The event")
    expect("A user asked for it." in event.message, "The event does not say why.")
    expect("first" in event.message, "The event does not name the campaign.")


def dates_moves(store: Store) -> None:
    """The start is the first start, the end is the end."""
    first = running(store)
    expect(first.started_ms is not None, "A running campaign has no start.")
    for step in (S.PAUSING, S.PAUSED, S.QUEUED, S.RUNNING):
        store.campaigns.move(first.id, step)
    again = store.campaigns.get(first.id)
    equal((again.started_ms, again.ended_ms), (first.started_ms, None), "Times after a pause")
    dead = store.campaigns.move(first.id, S.DEAD, "The disk is full.")
    expect(dead.ended_ms is not None, "A dead campaign has no end.")
    equal(dead.stopped_because, "The disk is full.", "The reason")
    equal(store.campaigns.get(first.id), dead, "The campaign that is read")


def ends_with_nothing_open(store: Store) -> None:
    """Whatever the end, what was open counts as cancelled, and there is a reason."""
    for end in sorted(FINAL_STATES):
        campaign = running(store)
        deliver(store, campaign, result(0), collision(1), failed(2))
        store.campaigns.move(campaign.id, S.CANCELLING)
        ended = store.campaigns.move(campaign.id, end)
        counts = Counts(10, completed=2, failures=1, failed=1, cancelled=7)
        equal(ended.counts, counts, f"Counts of a campaign that is {end}")
        expect(bool(ended.stopped_because), f"A campaign is {end} for no reason.")
        wanted = store.episodes.digest(campaign.id) if end is S.DONE else None
        equal(ended.digest, wanted, f"The digest of a campaign that is {end}")


def adds_up_active_time(store: Store) -> None:
    """Active time adds up."""
    campaign = running(store)
    for seconds in (1.5, 0.25):
        store.campaigns.add_active(campaign.id, seconds)
    equal(store.campaigns.get(campaign.id).active_s, 1.75, "Active time")


def queues_and_withdraws_jobs(store: Store) -> None:
    """A campaign that is paused or cancelled in the queue leaves it, and a resumed one is back."""
    paused, cancelled = (store.campaigns.create(spec()).id for _ in range(2))
    store.campaigns.move(paused, S.PAUSED)
    store.campaigns.move(cancelled, S.CANCELLED)
    equal(store.jobs.waiting(JobKind.CAMPAIGN), 0, "Jobs of campaigns that rest")
    equal(store.jobs.claim("a", 60.0), None, "What can be claimed then")
    for _ in range(2):
        store.campaigns.move(paused, S.QUEUED)
    equal(store.jobs.waiting(JobKind.CAMPAIGN), 1, "Jobs of a campaign that was resumed twice")
    job = store.jobs.claim("a", 60.0)
    equal(job and job.subject, paused, "The campaign of the claimed job")


CHECKS = (
    creates_queued,
    keeps_specs_exactly,
    repeats_a_key,
    refuses_a_key_for_two_specs,
    tells_requests_apart,
    knows_no_strangers,
    pages_newest_first,
    pages_one_state,
    moves_by_the_table,
    tells_of_moves,
    dates_moves,
    ends_with_nothing_open,
    adds_up_active_time,
    queues_and_withdraws_jobs,
)
