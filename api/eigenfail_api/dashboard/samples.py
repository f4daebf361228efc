"""A bounded number of a campaign's episodes, in a bounded number of questions to the store."""

from collections.abc import Iterator

from eigenfail.contracts import Store
from eigenfail.values import Campaign, Event
from eigenfail.values.records import EpisodeRow

MOST = 5_000
PAGE = 1_000
WINDOW = 100
EVENTS_LOOKED_AT = 1_000
EVENTS_SHOWN = 30


def sample_episodes(store: Store, campaign: Campaign) -> list[EpisodeRow]:
    """All finished episodes or, beyond `MOST`, windows of neighbours spread evenly over them."""
    reach = ended(campaign)
    if reach <= MOST:
        return list(first_rows(store, campaign.id))
    windows = MOST // WINDOW
    found: dict[int, EpisodeRow] = {}
    for window in range(windows):
        after = window * reach // windows - 1
        page = store.episodes.page(campaign.id, WINDOW, after if after >= 0 else None)
        found |= {row.index: row for row in page.items}
    return [found[index] for index in sorted(found)]


def ended(campaign: Campaign) -> int:
    """How many episodes have a result."""
    return campaign.counts.completed + campaign.counts.failed


def first_rows(store: Store, campaign: int) -> Iterator[EpisodeRow]:
    """The first `MOST` rows, page by page."""
    after: int | None = None
    for _ in range(MOST // PAGE):
        page = store.episodes.page(campaign, PAGE, after)
        yield from page.items
        after = page.next
        if after is None:
            return


def latest_events(store: Store, campaign: int) -> list[Event]:
    """The newest events of a campaign, newest first, as far as its first thousand reach."""
    events = store.events.after(0, EVENTS_LOOKED_AT, campaign)
    return events[: -EVENTS_SHOWN - 1 : -1]
