"""Checks of `CampaignStore.create_many`: all or none, once for each key."""

from accepted import accept_spec, accept_specs

from eigenfail.errors import IdempotencyMismatch
from eigenfail.testing import expect_error
from eigenfail.testing.examples import spec
from eigenfail.values.campaign import CampaignState
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.records import JobKind
from eigenfail_services.store.store import Store
from store_checks.crowds import CROWD, at_once
from store_checks.examples import equal


def batch(*seeds: int) -> list[CampaignSpec]:
    """Campaigns that differ in their seeds."""
    return [spec(seed=seed) for seed in seeds]


def creates_many_in_order(store: Store) -> None:
    """Each is what `create` makes: queued, with its job and its event."""
    equal(store.campaigns.create_many(accept_specs([])), (), "Campaigns of no spec")
    made = store.campaigns.create_many(accept_specs(batch(5, 3, 4)))
    equal([each.spec.seed for each in made], [5, 3, 4], "The order")
    equal({each.state for each in made}, {CampaignState.QUEUED}, "The states")
    equal([store.campaigns.get(each.id) for each in made], [*made], "The campaigns that are read")
    equal(store.jobs.waiting(JobKind.CAMPAIGN), 3, "Jobs")
    told = [(event.kind, event.campaign) for event in store.events.after(0, 10)]
    equal(told, [("campaign.created", each.id) for each in made], "Events")


def repeats_the_key_of_many(store: Store) -> None:
    """One key, one list: again it gets the same campaigns, as they stand by then."""
    made = store.campaigns.create_many(accept_specs(batch(1, 1, 2)), "key")
    moved = store.campaigns.move(made[0].id, CampaignState.RUNNING)
    events = store.events.last()
    again = store.campaigns.create_many(accept_specs(batch(1, 1, 2)), "key")
    equal(again, (moved, *made[1:]), "The campaigns of a repeated key")
    equal(store.events.last(), events, "Events after a repeated key")
    others = [
        store.campaigns.create_many(accept_specs(batch(1, 1, 2)), key) for key in (None, "other")
    ]
    ids = {each.id for some in (made, *others) for each in some}
    equal(len(ids), 9, "Campaigns without a key, and with another one")


def refuses_a_key_for_two_lists(store: Store) -> None:
    """A key stands for one list, neither longer nor shorter; what is refused leaves nothing."""
    store.campaigns.create_many(accept_specs(batch(1, 2)), "key")
    for other in (batch(1, 3), batch(2, 1), batch(1), batch(1, 2, 3)):
        with expect_error(IdempotencyMismatch, f"A key was accepted for {len(other)} others."):
            store.campaigns.create_many(accept_specs(other), "key")
    equal(len(store.campaigns.page(10).items), 2, "Campaigns after refused keys")
    equal(store.jobs.waiting(JobKind.CAMPAIGN), 2, "Jobs after refused keys")


def keeps_keys_of_one_and_of_many_apart(store: Store) -> None:
    """The same key may be sent with one campaign and with a list."""
    one = store.campaigns.create(accept_spec(spec()), "key")
    (many,) = store.campaigns.create_many(accept_specs([spec()]), "key")
    equal(len({one.id, many.id}), 2, "Campaigns")
    equal(store.campaigns.create(accept_spec(spec()), "key"), one, "The one")
    equal(store.campaigns.create_many(accept_specs([spec()]), "key"), (many,), "The list")


def one_key_makes_many_once(store: Store) -> None:
    """One list, sent by everybody at once, is made once."""
    found = at_once(lambda _: store.campaigns.create_many(accept_specs(batch(*range(5))), "key"))
    equal([each for each in found if each != found[0]], [], "What others were answered")
    equal(len(store.campaigns.page(10 * CROWD).items), 5, "Campaigns in the store")
