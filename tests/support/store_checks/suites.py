"""Checks of what `CampaignStore` knows of suites."""

from accepted import accept_spec

from eigenfail.errors import IdempotencyMismatch
from eigenfail.testing.examples import collision, make_errored_result, result, spec
from eigenfail.values.campaign import CampaignFilter, CampaignState
from eigenfail.values.records import Page
from eigenfail.values.suite import SuiteStanding
from eigenfail_services.store.campaign_creation import request_one
from eigenfail_services.store.store import Store
from store_checks.examples import deliver, equal, running

S = CampaignState


def ids(store: Store, *names: str) -> list[int]:
    """Campaigns of these names, in order."""
    return [store.campaigns.create(accept_spec(spec(name=name))).id for name in names]


def finds_the_campaigns_of_a_suite(store: Store) -> None:
    """What stands before the first ": " is a campaign's suite, to the letter."""
    names = ("a: one", "alone", "a: two: three", "A: one", "ab: one", "a:four", ": a", "a: ")
    first, _, third, *_ = ids(store, *names)
    found = store.campaigns.page(10, where=CampaignFilter(suite="a"))
    equal([campaign.id for campaign in found.items], [third, first], "Campaigns of a suite")
    for other in ("", "a: two", "b", "%", "_"):
        equal(
            store.campaigns.page(10, where=CampaignFilter(suite=other)),
            Page(()),
            f"Campaigns of the suite '{other}'",
        )


def leaves_out_what_was_made_of_members(store: Store) -> None:
    """Replays and minimal failures of campaigns belong to no suite."""
    replays = ("replay of analysis 3", "replay of analysis 3, lanes=2", "replay of 1/20")
    names = (*replays, "replay of 1/20, noise × 0.5", "minimal failure of 1/20")
    ids(store, *(f"a: one: {name}" for name in names), *(f"first: {name}" for name in names))
    equal(
        store.campaigns.page(10, where=CampaignFilter(suite="a")),
        Page(()),
        "Campaigns made of a member",
    )
    equal(store.campaigns.suites(10), Page(()), "Suites of campaigns that were made of others")
    ids(store, "a: replay of analysis three")
    equal(
        len(store.campaigns.page(10, where=CampaignFilter(suite="a")).items),
        1,
        "Members that are called alike",
    )


def lists_suites(store: Store) -> None:
    """Suites with sums over their campaigns, those with the newest campaigns first."""
    member = running(store, name="b: 1")
    deliver(store, member, collision(0), result(1))
    newest_of_a, _, newest_of_b = ids(store, "a: 1", "alone", "b: 2")
    sums = {"planned": 20, "completed": 2, "failures": 1}
    states = {S.QUEUED: 1, S.RUNNING: 1}
    b = SuiteStanding(name="b", newest=newest_of_b, campaigns=2, states=states, **sums)
    sums = {"planned": 10, "completed": 0, "failures": 0}
    queued = {S.QUEUED: 1}
    a = SuiteStanding(name="a", newest=newest_of_a, campaigns=1, states=queued, **sums)
    equal(store.campaigns.suites(10), Page((b, a)), "Suites")
    first = store.campaigns.suites(1)
    equal(first, Page((b,), newest_of_b), "The first page of suites")
    equal(store.campaigns.suites(1, first.next), Page((a,)), "The last page of suites")
    equal(store.campaigns.suites(1, newest_of_a), Page(()), "Suites behind the last one")


def tells_errored_campaigns_of_suites_apart(store: Store) -> None:
    """A campaign that is done without a completed episode is errored, and counted as done, too."""
    for episodes in ((make_errored_result(0),), (make_errored_result(0), result(1)), ()):
        member = running(store, name=f"e: {len(episodes)}")
        deliver(store, member, *episodes)
        store.campaigns.move(member.id, S.DONE)
    (suite,) = store.campaigns.suites(10).items
    equal((suite.states, suite.errored), ({S.DONE: 3}, 1), "States")
    equal(suite.state_words, {"done": 2, "errored": 1}, "States as people read them")


def takes_any_name(store: Store) -> None:
    """Names of suites that databases find odd."""
    odd = ("σ ✓", "a/b", "%", "\x00", "'\"; --")
    made = ids(store, *(f"{name}: one" for name in odd))
    listed = [suite.name for suite in store.campaigns.suites(10).items]
    for name, campaign in zip(listed[::-1], made, strict=True):
        found = [
            each.id for each in store.campaigns.page(10, where=CampaignFilter(suite=name)).items
        ]
        equal(found, [campaign], f"Campaigns of the suite {name!r}")


def creates_what_is_missing_of_a_suite(store: Store) -> None:
    """Campaigns of unknown keys are created beside those of known ones, all or none."""
    first, second, third = (spec(name=f"m: {n}", seed=n) for n in range(3))
    known = store.campaigns.create(accept_spec(second), "key-2").id
    made = store.campaigns.create_all(
        [request_one(accept_spec(first), "key-1"), request_one(accept_spec(second), "key-2")]
    )
    equal([each.spec.seed for each in made], [0, 1], "Campaigns in the order of their keys")
    equal(made[1].id, known, "The campaign of a known key")
    equal(
        store.campaigns.create_all([request_one(accept_spec(first), "key-1")]),
        made[:1],
        "A repeated call",
    )
    equal(
        store.campaigns.create(accept_spec(first), "key-1"),
        made[0],
        "The same key of a single campaign",
    )
    try:
        store.campaigns.create_all(
            [request_one(accept_spec(third), "key-3"), request_one(accept_spec(first), "key-2")]
        )
    except IdempotencyMismatch:
        pass
    else:
        raise AssertionError("A key of another spec was accepted.")
    found = store.campaigns.page(10, where=CampaignFilter(suite="m")).items
    equal([each.spec.seed for each in found], [0, 1], "Campaigns after a refused call")
