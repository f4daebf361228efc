"""Checks of how campaigns move from state to state in a `CampaignStore`."""

from accepted import accept_spec

from eigenfail.errors import IllegalTransition
from eigenfail.testing import expect, expect_error
from eigenfail.testing.examples import make_errored_result, result, spec
from eigenfail.values.campaign import Campaign, CampaignState
from eigenfail_services.store.store import Store
from store_checks.examples import deliver, equal, running

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
