"""Checks of how campaigns move from state to state in a `CampaignStore`."""

from accepted import accept_spec

from eigenfail.errors import IllegalTransition, NotFound
from eigenfail.testing import expect, expect_error
from eigenfail.testing.examples import collision, make_errored_result, result, spec
from eigenfail.values.campaign import FINAL_STATES, Campaign, CampaignState, Counts
from eigenfail.values.records import JobKind
from eigenfail_services.store.store import Store
from store_checks.examples import BEYOND, deliver, equal, running

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
    campaign = store.campaigns.create(accept_spec(spec()))
    for step in WAYS[state]:
        campaign = store.campaigns.move(campaign.id, step)
    return campaign


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
    store.campaigns.move(campaign.id, S.PAUSING, "Requested by a user.")
    event = store.events.after(0, 10)[-1]
    equal((event.kind, event.campaign), ("campaign.state", campaign.id), "The event")
    expect("Requested by a user." in event.message, "The event does not say why.")
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
        deliver(store, campaign, result(0), collision(1), make_errored_result(2))
        store.campaigns.move(campaign.id, S.CANCELLING)
        ended = store.campaigns.move(campaign.id, end)
        counts = Counts(10, completed=2, failures=1, errored=1, cancelled=7)
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
    paused, cancelled = (store.campaigns.create(accept_spec(spec())).id for _ in range(2))
    store.campaigns.move(paused, S.PAUSED)
    store.campaigns.move(cancelled, S.CANCELLED)
    equal(store.jobs.waiting(JobKind.CAMPAIGN), 0, "Jobs of campaigns that rest")
    equal(store.jobs.claim("a", 60.0), None, "What can be claimed then")
    for _ in range(2):
        store.campaigns.move(paused, S.QUEUED)
    equal(store.jobs.waiting(JobKind.CAMPAIGN), 1, "Jobs of a campaign that was resumed twice")
    job = store.jobs.claim("a", 60.0)
    equal(job and job.subject, paused, "The campaign of the claimed job")


def records_the_versions_of_each_part(store: Store) -> None:
    """Other versions begin another part; an event tells of it once there are results."""
    first, second = {"eigenfail": "1.0.0", "numpy": "2.0"}, {"eigenfail": "1.1.0", "numpy": "2.0"}
    campaign = running(store)
    equal(store.campaigns.get(campaign.id).parts, (), "Before it began")
    store.campaigns.begin_part(campaign.id, second)
    after = store.campaigns.begin_part(campaign.id, first)
    equal([part.versions for part in after.parts], [first], "Before the first result")
    deliver(store, campaign, result(0), make_errored_result(1))
    events = store.events.last()
    equal(
        store.campaigns.begin_part(campaign.id, dict(first)), store.campaigns.get(campaign.id), ""
    )
    equal(store.events.last(), events, "The same versions are no event")
    mixed = store.campaigns.begin_part(campaign.id, second)
    equal([part.results for part in mixed.parts], [0, 2], "Results when each part began")
    equal((mixed.is_mixed, after.is_mixed), (True, False), "Whether it is mixed")
    equal(store.campaigns.get(campaign.id), mixed, "What is kept")
    (event,) = store.events.after(events, 10)
    equal(event.kind, "campaign.mixed_releases", "The event")
    expect("after 2 results: eigenfail 1.0.0 then, 1.1.0 now." in event.message, event.message)
    with expect_error(NotFound, "A campaign that does not exist has parts."):
        store.campaigns.begin_part(BEYOND[0], first)


CHECKS = (
    records_the_versions_of_each_part,
    moves_by_the_table,
    tells_of_moves,
    dates_moves,
    ends_with_nothing_open,
    adds_up_active_time,
    queues_and_withdraws_jobs,
)
