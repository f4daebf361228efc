"""Checks of `CampaignStore`: what it makes, and how it is found."""

import time

from accepted import accept_spec

from eigenfail.errors import IdempotencyMismatch, InvalidValue
from eigenfail.filters import parse_campaign_sort
from eigenfail.testing import expect, expect_error
from eigenfail.testing.examples import collision, result, spec
from eigenfail.values.campaign import CampaignFilter, CampaignState, Counts
from eigenfail.values.records import Delivery, JobKind
from eigenfail_services.store.store import Store
from store_checks.examples import equal

S = CampaignState


def creates_queued(store: Store) -> None:
    """A new campaign waits, with a job and an event that says so."""
    before_ms = time.time_ns() // 1_000_000
    campaign = store.campaigns.create(accept_spec(spec(name="first")))
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
    equal(
        store.campaigns.get(store.campaigns.create(accept_spec(given)).id).spec, given, "The spec"
    )


def repeats_a_key(store: Store) -> None:
    """One key, one campaign: the second request gets the first one's, as it stands by then."""
    first = store.campaigns.create(accept_spec(spec()), "key")
    store.campaigns.move(first.id, S.RUNNING)
    events, waiting = store.events.last(), store.jobs.waiting(JobKind.CAMPAIGN)
    again = store.campaigns.create(accept_spec(spec()), "key")
    equal((again.id, again.state), (first.id, S.RUNNING), "The campaign of a repeated key")
    equal(store.events.last(), events, "Events after a repeated key")
    equal(store.jobs.waiting(JobKind.CAMPAIGN), waiting, "Jobs after a repeated key")


def refuses_a_key_for_two_specs(store: Store) -> None:
    """A key stands for one request."""
    store.campaigns.create(accept_spec(spec()), "key")
    with expect_error(IdempotencyMismatch, "A key was accepted for another spec."):
        store.campaigns.create(accept_spec(spec(seed=1)), "key")
    equal(len(store.campaigns.page(10).items), 1, "Campaigns after a refused key")


def pages_newest_first(store: Store) -> None:
    """Pages follow each other without gap or overlap, and end."""
    ids = [store.campaigns.create(accept_spec(spec())).id for _ in range(5)]
    seen, before = [], None
    for _ in range(3):
        page = store.campaigns.page(2, before)
        seen += [campaign.id for campaign in page.items]
        before = page.next
    equal(seen, ids[::-1], "Campaigns over three pages of two")
    equal(before, None, "The cursor of the last page")
    equal(store.campaigns.page(5).next, None, "The cursor of a page that holds just everything")
    equal(store.campaigns.page(5, before=2**70).items[0].id, ids[-1], "The first below 2**70")


def sorts_campaigns(store: Store) -> None:
    """In each order pages follow each other; equal values are newest first, unknown ones last."""
    names = ("b", "a", "C", "a")
    ids = [
        store.campaigns.create(accept_spec(spec(name=name, price_usd_per_hour=1.0))).id
        for name in names
    ]
    for campaign, crashes in zip(ids, (1, 2, 0, 2), strict=True):
        store.campaigns.move(campaign, S.RUNNING)
        store.campaigns.add_active(campaign, 36.0 * campaign)
        results = [collision(k) if k < crashes else result(k) for k in range(3)]
        store.episodes.commit(campaign, [Delivery(each, "w") for each in results])
    first, second, third, fourth = ids
    expected = {
        "id": [first, second, third, fourth],
        "name": [fourth, second, first, third],
        "-name": [third, first, fourth, second],
        "failures": [third, first, fourth, second],
        "-failures": [fourth, second, first, third],
        "completed": [fourth, third, second, first],
        "cost_per_failure_usd": [second, first, fourth, third],
        "-cost_per_failure_usd": [fourth, second, first, third],
        "-planner": [fourth, third, second, first],
        "method": [fourth, third, second, first],
        "state": [fourth, third, second, first],
    }
    for order, wanted in expected.items():
        seen, before = [], None
        for _ in wanted:
            page = store.campaigns.page(1, before, sort=parse_campaign_sort(order))
            seen += [campaign.id for campaign in page.items]
            before = page.next
        equal(seen, wanted, f"Campaigns by {order}")
        equal(before, None, f"The cursor of the last page by {order}")
    with expect_error(InvalidValue, "A page behind a campaign that does not exist was read."):
        store.campaigns.page(1, 2**40, sort=parse_campaign_sort("name"))


def pages_one_state(store: Store) -> None:
    """Pages of one state leave out the others."""
    paused, _, also = (store.campaigns.create(accept_spec(spec())).id for _ in range(3))
    for campaign in (paused, also):
        store.campaigns.move(campaign, S.PAUSED)
    first = store.campaigns.page(1, where=CampaignFilter(state=S.PAUSED))
    second = store.campaigns.page(1, first.next, CampaignFilter(state=S.PAUSED))
    equal([c.id for c in (*first.items, *second.items)], [also, paused], "Paused campaigns")
    equal(second.next, None, "The cursor of the last page")
