"""Noise and scenes that go to make room, in memory."""

from collections.abc import Iterable

from msgspec.structs import replace

from eigenfail.values import FINAL_STATES, CampaignSpec, EpisodeResult
from eigenfail.values.records import EpisodeRow
from eigenfail.values.retention import Pruning, Retention, Weight
from eigenfail_services.store import sentences
from eigenfail_services.store.clock import now_ms
from eigenfail_services.store.codec import pack
from eigenfail_services.store.memory.tables import Tables
from eigenfail_services.store.naming import OPEN, UNFINISHED, episodes_of, numbers
from eigenfail_services.store.refusals import not_ended, pruned, still_needed
from eigenfail_services.store.retention import SLICE

Found = list[tuple[EpisodeRow, EpisodeResult]]


class MemoryRetention:
    """Marks rows, slice by slice."""

    def __init__(self, tables: Tables) -> None:
        self._tables = tables

    def weigh(self, campaign: int, rule: Retention) -> Weight:
        """What goes by a rule, if it is applied now."""
        with self._tables.lock:
            self._tables.campaign(campaign)
            return weight(result for _, result in self._losable(campaign, rule))

    def prune(
        self, campaign: int, rule: Retention, who: str, begun: int | None = None
    ) -> Pruning | None:
        """Take away the next slice, and record it."""
        with self._tables.lock:
            if (subject := self._tables.campaign(campaign)).state not in FINAL_STATES:
                raise not_ended(subject)
            if campaign in self.in_use():
                raise still_needed(campaign)
            before = None if begun is None else self._tables.prunings[begun]
            last = before.through if before else -1
            found = [each for each in self._losable(campaign, rule) if each[0].index > last]
            if not found:
                return None
            record = before or self._begin(campaign, rule, who)
            return self._take(record, found[:SLICE])

    def in_use(self) -> frozenset[int]:
        """Campaigns whose noise others need that have not ended."""
        with self._tables.lock:
            every, asked = self._tables.campaigns.values(), self._tables.analyses.values()
            named = (numbers(each.spec.settings) for each in every if each.state in OPEN)
            read = (each.campaign for each in asked if each.state in UNFINISHED)
            return frozenset(read).union(*named)

    def of(self, campaign: int) -> tuple[Pruning, ...]:
        """What was taken from a campaign, oldest first."""
        with self._tables.lock:
            records = self._tables.prunings.values()
            return tuple(each for each in records if each.campaign == campaign)

    def _losable(self, campaign: int, rule: Retention) -> Found:
        rows = self._tables.episodes[campaign]
        return [
            rows[index]
            for index in sorted(rows)
            if rows[index][0].noise_pruned_ms is None
            and rule.takes(rows[index][0].outcome, rows[index][0].source, index)
        ]

    def _begin(self, campaign: int, rule: Retention, who: str) -> Pruning:
        self._tables.log("campaign.pruned", sentences.pruning(campaign, rule, who), campaign)
        return Pruning(
            id=len(self._tables.prunings) + 1,
            campaign=campaign,
            retention=rule,
            through=-1,
            pruned_ms=now_ms(),
            who=who,
            weight=Weight(),
        )

    def _take(self, record: Pruning, found: Found) -> Pruning:
        gone = weight(result for _, result in found)
        for row, result in found:
            lost = replace(row, noise_pruned_ms=record.pruned_ms, has_scene=False)
            self._tables.episodes[row.campaign][row.index] = lost, replace(result, scene=None)
        through = found[-1][0].index
        after = replace(record, through=through, weight=record.weight + gone)
        self._tables.prunings[record.id] = after
        return after


def weight(results: Iterable[EpisodeResult]) -> Weight:
    """How much is kept of some episodes."""
    return sum(map(weight_of, results), Weight())


def weight_of(result: EpisodeResult) -> Weight:
    """How much is kept of one."""
    arrays = (result.noise.z, result.noise.sigma, result.states)
    noise = sum(array.nbytes for array in arrays if array is not None)
    scene = 0 if result.scene is None else len(pack(result.scene))
    return Weight(1, int(result.scene is not None), noise + scene)


def refuse_gone(tables: Tables, specs: Iterable[CampaignSpec]) -> None:
    """Raises NoisePruned if an episode that a new campaign names has lost its noise."""
    for campaign, indices in (episodes_of(spec.settings) for spec in specs):
        rows = tables.episodes.get(campaign or 0, {})
        for row in (rows[index][0] for index in indices if index in rows):
            if row.noise_pruned_ms is not None:
                raise pruned(row.campaign, row.index, row.source, row.noise_pruned_ms)
