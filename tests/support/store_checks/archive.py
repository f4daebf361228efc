"""Checks of the archive: filters tell archived campaigns from others, and nothing is deleted."""

from accepted import accept_spec
from msgspec.structs import replace

from eigenfail.errors import IllegalTransition
from eigenfail.filters import parse_campaign_sort
from eigenfail.testing import expect_error
from eigenfail.testing.examples import spec
from eigenfail.values.campaign import CampaignFilter, CampaignState
from eigenfail_services.store.store import Store
from store_checks.examples import equal
from store_checks.modes import crashed

LISTED, ARCHIVED = CampaignFilter(archived=False), CampaignFilter(archived=True)


def ids(store: Store, where: CampaignFilter, sort: str = "-id") -> list[int]:
    """The ids of the campaigns that a filter finds."""
    order = parse_campaign_sort(sort)
    return [each.id for each in store.campaigns.page(10, where=where, sort=order).items]


def archives_campaigns_that_have_ended(store: Store) -> None:
    """An archived campaign is as it was, but for the time; a change is an event."""
    one, other = crashed(store), crashed(store)
    ended = store.campaigns.move(one.id, CampaignState.DONE)
    rows = store.episodes.page(one.id, 10).items
    archived = store.campaigns.archive(one.id)
    equal(replace(archived, archived_ms=None), ended, "The archived campaign")
    equal(store.campaigns.get(one.id), archived, "The archived campaign, asked for")
    equal(store.episodes.page(one.id, 10).items, rows, "Its episodes")
    equal((ids(store, LISTED), ids(store, ARCHIVED)), ([other.id], [one.id]), "Two lists")
    equal(ids(store, CampaignFilter(), "failures"), [other.id, one.id], "All campaigns, sorted")
    (event,) = store.events.latest(1)
    equal((event.kind, event.campaign), ("campaign.archive", one.id), "The event")
    before = store.events.last()
    equal(store.campaigns.archive(one.id), archived, "Archived again")
    equal(store.campaigns.restore(other.id).archived_ms, None, "Restored without an archive")
    equal(store.events.last(), before, "Events of changes to the same")
    equal(store.campaigns.restore(one.id), ended, "The campaign that is listed again")
    equal(ids(store, LISTED), [other.id, one.id], "The list that has it again")


def archives_nothing_that_goes_on(store: Store) -> None:
    """A campaign that has not ended is not archived."""
    waiting = store.campaigns.create(accept_spec(spec()))
    with expect_error(IllegalTransition, "A queued campaign was archived."):
        store.campaigns.archive(waiting.id)
    equal(ids(store, LISTED), [waiting.id], "The list after a refusal")
