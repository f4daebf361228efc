"""Sums over campaigns and their episodes, in memory."""

from collections.abc import Callable, Iterable, Sequence
from itertools import groupby
from math import ceil
from typing import TypeVar

from eigenfail.values import Campaign, Outcome
from eigenfail.values.pool import Peers, Pool
from eigenfail.values.records import EpisodeRow, Totals
from eigenfail.values.sample import MOST_SAMPLES, EpisodeSample
from eigenfail.values.worker import WorkerShare
from eigenfail_services.store.memory.episodes import MemoryEpisodes, ordered
from eigenfail_services.store.memory.tables import Tables

SECONDS_PER_HOUR = 3_600.0
PEERS = Peers.__struct_fields__

Item = TypeVar("Item")


class MemoryFigures:
    """Worked out anew every time."""

    def __init__(self, tables: Tables, episodes: MemoryEpisodes) -> None:
        self._tables = tables
        self._episodes = episodes

    def totals(self, campaigns: Sequence[int]) -> dict[int, Totals]:
        """Sums over the episodes of some campaigns, by their ids."""
        return {campaign: self._episodes.totals(campaign) for campaign in campaigns}

    def samples(self, campaign: int, most: int = MOST_SAMPLES) -> tuple[EpisodeSample, ...]:
        """At most so many of the completed episodes, evenly spread."""
        rows = self._rows(campaign)
        every = max(1, ceil((rows[-1].index + 1) / most)) if rows else 1
        return tuple(
            EpisodeSample(row.index, row.outcome, row.robustness_m)
            for row in rows
            if row.index % every == 0 and row.outcome is not Outcome.FAILED
        )

    def workers(self, campaign: int) -> tuple[WorkerShare, ...]:
        """Who ran the episodes of a campaign."""
        return shares(self._rows(campaign))

    def workers_since(self, at_ms: int) -> tuple[WorkerShare, ...]:
        """Who brought results since then, and of which campaigns."""
        with self._tables.lock:
            rows = [row for campaign in self._tables.campaigns for row in self._rows(campaign)]
        return shares(row for row in rows if row.finished_ms >= at_ms)

    def pools(self) -> tuple[Pool, ...]:
        """All campaigns by peers and method, the newest first."""
        with self._tables.lock:
            campaigns = list(self._tables.campaigns.values())
        found = [pool(same) for same in grouped(campaigns, peers_and_method)]
        return tuple(sorted(found, key=lambda each: each.newest, reverse=True))

    def _rows(self, campaign: int) -> list[EpisodeRow]:
        return [row for row, _ in ordered(self._tables, campaign)]


def grouped(items: Iterable[Item], key: Callable[[Item], tuple[object, ...]]) -> list[list[Item]]:
    """Items of one key together, in their order."""
    in_order = sorted(items, key=lambda item: str(key(item)))
    return [list(same) for _, same in groupby(in_order, lambda item: str(key(item)))]


def shares(rows: Iterable[EpisodeRow]) -> tuple[WorkerShare, ...]:
    """Who ran some episodes; who ran most comes first."""
    found = [share(same) for same in grouped(rows, lambda row: (row.worker, row.campaign))]
    return tuple(sorted(found, key=lambda each: (-each.episodes, each.worker, each.campaign)))


def share(rows: Sequence[EpisodeRow]) -> WorkerShare:
    """What one worker did for one campaign."""
    outcomes = [row.outcome for row in rows]
    return WorkerShare(
        worker=rows[0].worker,
        campaign=rows[0].campaign,
        episodes=len(rows),
        failures=outcomes.count(Outcome.COLLISION),
        failed=outcomes.count(Outcome.FAILED),
        wall_s=sum(row.wall_s for row in rows),
        last_ms=max(row.finished_ms for row in rows),
    )


def peers_and_method(campaign: Campaign) -> tuple[object, ...]:
    """What campaigns of a pool have in common."""
    return peers(campaign), campaign.spec.method


def peers(campaign: Campaign) -> Peers:
    """The part of a spec against which costs can be held."""
    return Peers(**{name: getattr(campaign.spec, name) for name in PEERS})


def pool(campaigns: Sequence[Campaign]) -> Pool:
    """Sums over campaigns of one pool."""
    hours = [each.active_s * each.spec.instances / SECONDS_PER_HOUR for each in campaigns]
    prices = [each.spec.price_usd_per_hour for each in campaigns]
    return Pool(
        peers=peers(campaigns[0]),
        method=campaigns[0].spec.method,
        campaigns=len(campaigns),
        newest=max(each.id for each in campaigns),
        completed=sum(each.counts.completed for each in campaigns),
        failures=sum(each.counts.failures for each in campaigns),
        instance_hours=sum(hours),
        total_usd=sum(hour * price for hour, price in zip(hours, prices, strict=True)),
    )
