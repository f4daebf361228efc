"""A bounded number of a campaign's episodes, and what their likelihood is compared with."""

from collections.abc import Iterable, Iterator
from typing import NamedTuple

import msgspec
import numpy as np

from eigenfail.errors import NoisePruned
from eigenfail.filters import Condition, Conditions, Operator
from eigenfail.values import Campaign, NoiseTrajectory
from eigenfail.values.records import EpisodeRow
from eigenfail_services.campaigns.cache import StoreCache
from eigenfail_services.statistics.expected_likelihood import expected_log_probability
from eigenfail_services.store import Store

MOST = 5_000
PAGE = 1_000
WINDOW = 100
LINES = 2_000
STRETCHES = 40


def sample_episodes(store: Store, campaign: Campaign) -> list[EpisodeRow]:
    """All finished episodes or, beyond `MOST`, windows of neighbours spread evenly over them."""
    reach = count_ended(campaign)
    if reach <= MOST:
        return list(first_rows(store, campaign.id))
    windows = MOST // WINDOW
    found: dict[int, EpisodeRow] = {}
    for window in range(windows):
        after = window * reach // windows - 1
        page = store.episodes.page(campaign.id, WINDOW, after if after >= 0 else None)
        found |= {row.index: row for row in page.items}
    return [found[index] for index in sorted(found)]


def count_ended(campaign: Campaign) -> int:
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
    reach, each = count_ended(campaign), LINES // STRETCHES
    rows: list[EpisodeRow] = []
    for stretch in range(STRETCHES):
        first, last = (reach * n // STRETCHES for n in (stretch, stretch + 1))
        within = (
            Condition("index", Operator.AT_LEAST, first),
            Condition("index", Operator.BELOW, last),
        )
        rows += store.episodes.page(campaign.id, each, None, (*where, *within)).items
    return Spread(tuple(rows), is_all=False)


MOST_FAILURES = 8
"""Sigma follows the course of an episode, which differs little between failures."""

MOST_CAMPAIGNS = 500


class PriorReference(msgspec.Struct, frozen=True):
    """log p per step that other noise has over the steps of some failures, at their sigma.

    Attributes:
        typical: of noise drawn from p(x), on average. [nats]
        none: of no noise at all: none is likelier. [nats]
        failures: how many were looked at.
    """

    typical: float
    none: float
    failures: int


# An open page asks again and again for the same failures, whose noise never changes.
KNOWN: StoreCache[PriorReference | None] = StoreCache(MOST_CAMPAIGNS)


def reference_of(store: Store, campaign: int, failures: Iterable[int]) -> PriorReference | None:
    """Over the steps of failures by their indices; None without any, or where noise was pruned."""
    indices = tuple(failures)
    try:
        return KNOWN.get(store, campaign, indices, lambda: looked_up(store, campaign, indices))
    except NoisePruned:
        return None


def looked_up(store: Store, campaign: int, failures: Iterable[int]) -> PriorReference | None:
    """The same, from the noise that is stored.

    Raises:
        NoisePruned: it is not stored any more.
    """
    found = store.episodes.finished(campaign, failures)
    return reference([result.noise for result in found if result.steps])


def reference(noises: list[NoiseTrajectory]) -> PriorReference | None:
    """Over the steps of these; None of nothing."""
    steps = sum(len(noise.z) for noise in noises)
    if not steps:
        return None
    return PriorReference(
        typical=sum(map(expected_log_probability, noises)) / steps,
        none=sum(noise.log_probability for noise in map(remove_noise, noises)) / steps,
        failures=len(noises),
    )


def remove_noise(noise: NoiseTrajectory) -> NoiseTrajectory:
    """The same steps without noise."""
    return NoiseTrajectory(np.zeros_like(noise.z), noise.sigma, noise.shape)
