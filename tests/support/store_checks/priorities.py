"""Checks of priorities: of `CampaignStore`, and of the order of `JobQueue`."""

from accepted import accept_spec, accept_specs

from eigenfail.errors import IdempotencyMismatch, IllegalTransition
from eigenfail.testing import expect_error
from eigenfail.testing.examples import spec
from eigenfail.values.analysis import AnalysisSettings
from eigenfail.values.campaign import CampaignState
from eigenfail.values.campaign_spec import Priority
from eigenfail.values.records import JobKind
from eigenfail_services.store.store import Store
from store_checks.examples import equal

LONG_S = 600.0
LOW, NORMAL, HIGH = Priority


def keeps_priorities(store: Store) -> None:
    """Each campaign its own, as it was asked for, then as it was changed; a change is an event."""
    made = [store.campaigns.create(accept_spec(spec(priority=priority))) for priority in Priority]
    equal([each.spec.priority for each in made], [LOW, NORMAL, HIGH], "Priorities as asked for")
    changed = store.campaigns.prioritise(made[0].id, HIGH)
    equal(changed.spec, spec(priority=HIGH), "A campaign with another priority")
    for each, wanted in zip(made, (HIGH, NORMAL, HIGH), strict=True):
        equal(store.campaigns.get(each.id).spec.priority, wanted, "A priority as it is kept")
    before = store.events.last()
    equal(store.campaigns.prioritise(made[0].id, HIGH), changed, "The same priority again")
    equal(store.events.last(), before, "Events of a change to the same")
    (event,) = store.events.latest(1)
    equal((event.kind, event.campaign), ("campaign.priority", made[0].id), "The event of a change")


def changes_no_priority_at_the_end(store: Store) -> None:
    """Whatever is queued, at work or paused may be given another; what has ended, not."""
    campaign = store.campaigns.create(accept_spec(spec())).id
    for state in (CampaignState.RUNNING, CampaignState.PAUSING, CampaignState.PAUSED):
        store.campaigns.move(campaign, state)
        store.campaigns.prioritise(campaign, HIGH)
        store.campaigns.prioritise(campaign, LOW)
    ended = store.campaigns.move(campaign, CampaignState.CANCELLED)
    with expect_error(IllegalTransition, "A campaign that had ended was given a priority."):
        store.campaigns.prioritise(campaign, HIGH)
    equal(store.campaigns.get(campaign), ended, "The campaign that had ended")


def knows_requests_at_whatever_priority(store: Store) -> None:
    """A request that is repeated gives the same campaigns, also after one was hurried."""
    one = store.campaigns.create(accept_spec(spec()), "one")
    many = store.campaigns.create_many(accept_specs([spec(), spec(seed=1)]), "many")
    hurried = store.campaigns.prioritise(one.id, HIGH)
    store.campaigns.prioritise(many[1].id, LOW)
    equal(store.campaigns.create(accept_spec(spec()), "one"), hurried, "The same request again")
    again = store.campaigns.create_many(accept_specs([spec(), spec(seed=1, priority=HIGH)]), "many")
    equal([each.id for each in again], [each.id for each in many], "The same list again")
    with expect_error(IdempotencyMismatch, "Another request was taken for the first."):
        store.campaigns.create_many(accept_specs([spec(), spec(seed=2)]), "many")
    with expect_error(IdempotencyMismatch, "A shorter list was taken for the first."):
        store.campaigns.create_many(accept_specs([spec()]), "many")


def claims_the_urgent_first(store: Store) -> None:
    """By priority, then by age; an analysis waits like a campaign of normal priority."""
    asked = (LOW, NORMAL, HIGH, LOW, HIGH)
    made = [store.campaigns.create(accept_spec(spec(priority=priority))).id for priority in asked]
    store.analyses.create(made[0], AnalysisSettings())
    store.campaigns.prioritise(made[3], HIGH)
    jobs = [store.jobs.claim("a", LONG_S) for _ in range(6)]
    found = [job and (job.subject if job.kind is JobKind.CAMPAIGN else "analysis") for job in jobs]
    wanted = [made[2], made[3], made[4], made[1], "analysis", made[0]]
    equal(found, wanted, "What is claimed, one after the other")
