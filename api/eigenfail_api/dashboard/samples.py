"""A bounded number of a campaign's episodes, in a bounded number of questions to the store."""

from collections.abc import Iterator
from typing import NamedTuple

from eigenfail.contracts import Store
from eigenfail.filters import Condition, Conditions, Operator
from eigenfail.values import Campaign
from eigenfail.values.records import EpisodeRow

MOST = 5_000
PAGE = 1_000
WINDOW = 100
LINES = 2_000
STRETCHES = 40


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


class Spread(NamedTuple):
    """Episodes that match some conditions: all of them, or a sample."""

    rows: tuple[EpisodeRow, ...]
    is_all: bool


def spread(store: Store, campaign: Campaign, where: Conditions) -> Spread:
    """All that match or, beyond `LINES`, the first of each of many stretches of the campaign."""
    page = store.episodes.page(campaign.id, LINES, None, where)
    if page.next is None:
        return Spread(page.items, is_all=True)
    reach, each = ended(campaign), LINES // STRETCHES
    rows: list[EpisodeRow] = []
    for stretch in range(STRETCHES):
        first, last = (reach * n // STRETCHES for n in (stretch, stretch + 1))
        within = (
            Condition("index", Operator.AT_LEAST, first),
            Condition("index", Operator.BELOW, last),
        )
        rows += store.episodes.page(campaign.id, each, None, (*where, *within)).items
    return Spread(tuple(rows), is_all=False)
