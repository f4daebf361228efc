"""Results of episodes in memory."""

import hashlib
from collections import Counter
from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any

from msgspec.structs import replace

from eigenfail.filters import BY_INDEX, Conditions, Sort, matches, value_of
from eigenfail.values import (
    BlockTotals,
    ConflictClass,
    EpisodeResult,
    Outcome,
    Page,
    PairTotals,
    SafetyTotals,
    SpendingTotals,
    Trials,
)
from eigenfail.values.records import (
    PORTION,
    ConflictTotals,
    Delivery,
    EpisodeRow,
    Failures,
    Totals,
    Verdict,
)
from eigenfail.values.region import MOST_TRIALS
from eigenfail.values.safety import MOST_POINTS
from eigenfail.values.spending import MOST_LANDINGS
from eigenfail_services.store import sentences
from eigenfail_services.store.clock import now_ms
from eigenfail_services.store.judging import judge, row_of
from eigenfail_services.store.memory.blocks import course, paired
from eigenfail_services.store.memory.safety import safety
from eigenfail_services.store.memory.spending import spending
from eigenfail_services.store.memory.tables import Tables
from eigenfail_services.store.memory.trials import trials
from eigenfail_services.store.refusals import no_episode, pruned


class MemoryEpisodes:
    """Results, read and written."""

    def __init__(self, tables: Tables) -> None:
        self._tables = tables

    def commit(self, campaign: int, deliveries: Sequence[Delivery]) -> list[Verdict]:
        """Keep results, update the counts, and log alarms; one verdict for each delivery."""
        with self._tables.lock:
            before = self._tables.campaign(campaign)
            episodes = self._tables.episodes[campaign]
            known = {index: row.digest for index, (row, _) in episodes.items()}
            judgement, at_ms = judge(before, known, deliveries), now_ms()
            for kept in judgement.kept:
                row = row_of(campaign, kept, at_ms)
                episodes[row.index] = (row, kept.result)
            self._tables.campaigns[campaign] = replace(before, counts=judgement.counts)
            for alarm in judgement.alarms:
                message = sentences.episode_alarm(campaign, alarm.result.index, alarm.worker)
                self._tables.log("episode.alarm", message, campaign)
        return judgement.verdicts

    def add_death(self, campaign: int, index: int) -> int:
        """One more worker was lost while it ran this episode; how many that makes."""
        with self._tables.lock:
            self._tables.campaign(campaign)
            self._tables.deaths[campaign, index] += 1
            return self._tables.deaths[campaign, index]

    def get(self, campaign: int, index: int) -> EpisodeResult:
        """One result with everything that is kept of it."""
        with self._tables.lock:
            self._tables.campaign(campaign)
            episodes = self._tables.episodes[campaign]
            if index not in episodes:
                raise no_episode(campaign, index)
            return kept(*episodes[index])

    def page(
        self,
        campaign: int,
        limit: int,
        after: int | None = None,
        where: Conditions = (),
        sort: Sort = BY_INDEX,
    ) -> Page[EpisodeRow]:
        """Episodes that fulfil all conditions, in an order, those behind `after`."""
        rows = {row.index: row for row, _ in ordered(self._tables, campaign)}
        found = [row for row in behind(rows, after, sort) if matches(row, where)]
        return Page(tuple(found[:limit]), found[limit - 1].index if len(found) > limit else None)

    def finished(self, campaign: int, indices: Iterable[int]) -> list[EpisodeResult]:
        """Those of the episodes that have a result, in index order, without their scenes."""
        wanted = set(indices)
        return [
            replace(kept(row, result), scene=None)
            for row, result in ordered(self._tables, campaign)
            if row.index in wanted
        ]

    def failures(self, campaign: int) -> Failures:
        """The noise of all collisions."""
        found = [r for _, r in ordered(self._tables, campaign) if r.is_failure]
        return Failures(tuple(r.index for r in found), tuple(r.noise.z for r in found))

    def failure_portions(self, campaign: int) -> Iterator[Failures]:
        """The noise of all collisions, some at a time."""
        whole = self.failures(campaign)
        for first in range(0, len(whole.indices), PORTION):
            last = first + PORTION
            yield Failures(whole.indices[first:last], whole.noise[first:last])

    def totals(self, campaign: int) -> Totals:
        """Sums over all collisions, and episodes counted by class."""
        rows = [row for row, _ in ordered(self._tables, campaign)]
        collisions = [row for row in rows if row.outcome is Outcome.COLLISION]
        severities = [row.severity for row in collisions if row.severity is not None]
        return Totals(
            len(collisions),
            sum((row.log_probability for row in collisions), 0.0),
            sum(row.steps for row in collisions),
            sum(severities) if severities else None,
            conflict_totals(rows),
        )

    def course(self, campaign: int, per: int) -> list[BlockTotals]:
        """Sums over blocks of `per` indices, in index order."""
        return course([row for row, _ in ordered(self._tables, campaign)], per)

    def safety(self, campaign: int, most: int = MOST_POINTS) -> SafetyTotals:
        """Safety measures over the completed episodes, with at most so many points."""
        return safety([row for row, _ in ordered(self._tables, campaign)], most)

    def trials(self, campaign: int, most: int = MOST_TRIALS) -> Trials:
        """Seeds and outcomes of the completed episodes, of at most so many."""
        return trials([row for row, _ in ordered(self._tables, campaign)], most)

    def spending(self, campaign: int, most: int = MOST_LANDINGS) -> SpendingTotals:
        """Worker time in the episodes, and when they landed."""
        return spending([row for row, _ in ordered(self._tables, campaign)], most)

    def paired(self, first: int, second: int) -> PairTotals:
        """The episodes that two campaigns both completed."""
        one, other = ([row for row, _ in ordered(self._tables, c)] for c in (first, second))
        return paired(one, other)

    def digest(self, campaign: int) -> str:
        """SHA-256 over the digests of all results in index order."""
        return digest(self._tables, campaign)


def kept(row: EpisodeRow, result: EpisodeResult) -> EpisodeResult:
    """A result whose noise is there, or NoisePruned."""
    if row.noise_pruned_ms is not None:
        raise pruned(row.campaign, row.index, row.source, row.noise_pruned_ms)
    return result


def ordered(tables: Tables, campaign: int) -> list[tuple[EpisodeRow, EpisodeResult]]:
    """The results of a campaign in index order; none of a campaign that does not exist."""
    with tables.lock:
        episodes = tables.episodes.get(campaign, {})
        return [episodes[index] for index in sorted(episodes)]


def digest(tables: Tables, campaign: int) -> str:
    """SHA-256 over one line "index digest" for each result, in index order."""
    lines = (f"{row.index} {row.digest}\n" for row, _ in ordered(tables, campaign))
    return hashlib.sha256("".join(lines).encode()).hexdigest()


def conflict_totals(rows: list[EpisodeRow]) -> ConflictTotals:
    """Episodes counted by class, and their lead times summed in index order."""
    classes = Counter((row.outcome, row.assessed.conflict) for row in rows)
    ended = Counter(row.assessed.unresolved for row in rows)
    ttc = [row.assessed.ttc_lead_s for row in rows if row.assessed.ttc_lead_s is not None]
    drac = [row.assessed.drac_lead_s for row in rows if row.assessed.drac_lead_s is not None]
    return ConflictTotals(
        unavoidable=classes[Outcome.COLLISION, ConflictClass.UNAVOIDABLE],
        planner_failures=classes[Outcome.COLLISION, ConflictClass.PLANNER_FAILURE],
        unclassified=classes[Outcome.COLLISION, None],
        near_misses=classes[Outcome.SAFE, ConflictClass.NEAR_MISS],
        ttc_lead_s=sum(ttc, 0.0),
        ttc_leads=len(ttc),
        drac_lead_s=sum(drac, 0.0),
        drac_leads=len(drac),
        unresolved=ended[True],
        perhaps_unresolved=ended[None],
    )


def behind(rows: Mapping[int, EpisodeRow], after: int | None, sort: Sort) -> list[EpisodeRow]:
    """All rows behind one in an order; none if there is no such row, except in that of indices."""
    known = [row for row in rows.values() if value_of(row, sort.column) is not None]
    unknown = [row for row in rows.values() if value_of(row, sort.column) is None]
    by_value = sorted(known, key=partial(place, sort), reverse=sort.descending)
    in_order = by_value + sorted(unknown, key=index_of, reverse=sort.descending)
    if after is None:
        return in_order
    if sort.column == "index":
        return [row for row in in_order if is_behind(row.index, after, sort)]
    indices = [row.index for row in in_order]
    return in_order[indices.index(after) + 1 :] if after in rows else []


def is_behind(index: int, after: int, sort: Sort) -> bool:
    """Whether an index comes behind another one."""
    return index < after if sort.descending else index > after


def place(sort: Sort, row: EpisodeRow) -> tuple[Any, int]:
    """Where a row comes in an order."""
    return value_of(row, sort.column), row.index


def index_of(row: EpisodeRow) -> int:
    """Its index."""
    return row.index
