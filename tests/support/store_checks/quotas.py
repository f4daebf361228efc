"""Checks of quotas: of `KeyStore`, and of whether `CampaignStore` keeps to them."""

from collections.abc import Callable

from accepted import accept_spec, accept_specs

from eigenfail.errors import QuotaExceeded
from eigenfail.testing import expect
from eigenfail.testing.examples import result, spec
from eigenfail.values.access import UNLIMITED, Quotas, Scope, Usage
from eigenfail.values.campaign import CampaignState
from eigenfail.values.records import Page
from eigenfail_services.store.store import Store
from store_checks.examples import deliver, equal

DIGEST = "0123456789abcdef" * 4


def key_with(store: Store, quotas: Quotas = UNLIMITED) -> int:
    """A key with quotas."""
    return store.keys.create("ci", Scope.RUNNER, DIGEST, quotas=quotas).id


def refused(create: Callable[[], object], *words: str) -> None:
    """Expect that a quota is exceeded, and named with its limit and what is used."""
    try:
        create()
    except QuotaExceeded as error:
        for word in words:
            expect(word in str(error), f"'{word}' is not in: {error}")
        return
    raise AssertionError("More was made than the quota allows.")


def keeps_quotas(store: Store) -> None:
    """They come back as they were given, and as they were changed; those of others stay."""
    wanted = Quotas(3, 10**12, 10**15)
    one, other = key_with(store, wanted), key_with(store)
    equal(store.keys.find(one).key.quotas, wanted, "Quotas as they were given")
    equal(store.keys.find(other).key.quotas, UNLIMITED, "Quotas that were not")
    changed = store.keys.limit(one, Quotas(max_open=0))
    equal(changed.quotas, Quotas(max_open=0), "Quotas as they were changed")
    equal(store.keys.page(1, other), Page((changed,)), "A key in a list")


def counts_what_is_used(store: Store) -> None:
    """What has not ended is open; what was left unrun in the end is not counted as used."""
    key, other = key_with(store), key_with(store)
    first, second = (store.campaigns.create(accept_spec(spec()), made_by=key) for _ in range(2))
    store.campaigns.create(accept_spec(spec()))
    equal(store.keys.usage([key, other]), {key: Usage(2, 20), other: Usage()}, "What two keys use")
    store.campaigns.move(first.id, CampaignState.RUNNING)
    deliver(store, first, result(0), result(1))
    store.campaigns.move(first.id, CampaignState.DONE)
    store.campaigns.move(second.id, CampaignState.PAUSED)
    equal(store.keys.usage([key]), {key: Usage(1, 12)}, "What is used once one is done")
    equal(store.keys.usage([]), {}, "What nobody uses")


def bounds_what_is_open(store: Store) -> None:
    """One more is refused until one has ended; a key's campaigns alone count."""
    key = key_with(store, Quotas(max_open=2))
    made = [store.campaigns.create(accept_spec(spec()), made_by=key) for _ in range(2)]
    refused(
        lambda: store.campaigns.create(accept_spec(spec()), made_by=key),
        "max_open",
        "2",
        "cancel one",
    )
    store.campaigns.create(accept_spec(spec()))
    store.campaigns.create(accept_spec(spec()), made_by=key_with(store))
    store.campaigns.move(made[0].id, CampaignState.CANCELLED)
    store.campaigns.create(accept_spec(spec()), made_by=key)
    store.keys.limit(key, Quotas(max_open=3))
    store.campaigns.create(accept_spec(spec()), made_by=key)


def bounds_episodes(store: Store) -> None:
    """Of one campaign, and of all of a day."""
    key = key_with(store, Quotas(max_episodes=50, max_episodes_per_day=100))
    large = spec(episodes=51)
    refused(
        lambda: store.campaigns.create(accept_spec(large), made_by=key), "max_episodes)", "50", "51"
    )
    store.campaigns.create(accept_spec(spec(episodes=50)), made_by=key)
    last = store.campaigns.create(accept_spec(spec(episodes=50)), made_by=key)
    refused(
        lambda: store.campaigns.create(accept_spec(spec(episodes=1)), made_by=key),
        "max_episodes_per_day",
    )
    store.campaigns.move(last.id, CampaignState.CANCELLED)
    store.campaigns.create(accept_spec(spec(episodes=50)), made_by=key)


def refuses_all_or_nothing(store: Store) -> None:
    """Of a list that is too long, nothing is made; nor is its request remembered."""
    key = key_with(store, Quotas(max_open=2))
    three = [spec(seed=seed) for seed in range(3)]
    refused(
        lambda: store.campaigns.create_many(accept_specs(three), "k", made_by=key), "max_open", "3"
    )
    equal(store.campaigns.page(10), Page(()), "Campaigns after the refusal")
    made = store.campaigns.create_many(accept_specs(three[:2]), "k", made_by=key)
    equal(
        store.campaigns.create_many(accept_specs(three[:2]), "k", key),
        made,
        "The same request again",
    )


def repeats_what_was_made(store: Store) -> None:
    """A request that is repeated is answered, though there is no room for another."""
    key = key_with(store, Quotas(max_open=1))
    made = store.campaigns.create(accept_spec(spec()), "k", key)
    equal(store.campaigns.create(accept_spec(spec()), "k", key), made, "The same request again")
    refused(lambda: store.campaigns.create(accept_spec(spec()), "other", key), "max_open")
