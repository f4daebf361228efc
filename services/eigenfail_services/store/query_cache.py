"""Figures over campaigns and their episodes, and a cache of expensive answers.

Results are only ever added, so an answer about results holds as long as their number is the same.
"""

from collections import OrderedDict
from collections.abc import Callable, Hashable, Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from functools import partial, reduce
from math import ceil
from threading import Lock
from typing import Any, Concatenate, NamedTuple, ParamSpec, TypeVar

import msgspec
import sqlalchemy as sa

from eigenfail.values import summary
from eigenfail.values.campaign import Campaign
from eigenfail.values.comparison import Peers, Pool
from eigenfail.values.episode import Outcome
from eigenfail.values.operations import WorkerShare
from eigenfail.values.records import Totals
from eigenfail.values.safety import MOST_POINTS, SafetyTotals
from eigenfail_services.store import totals
from eigenfail_services.store.engine import Database, StorePart
from eigenfail_services.store.schema import (
    campaigns,
    episode_index,
    episodes,
    instance_hours,
    is_failure,
    spec_field,
    spent_usd,
)

Answer = TypeVar("Answer")

MOST_ANSWERS = 1_000
"""Answers that a store keeps; those about a campaign with many failures have a megabyte."""

MOST_TOTALS = 20_000
"""Campaigns whose sums are kept, a kilobyte each: lists show hundreds of campaigns at a time."""

_NEVER = object()


class _Entry:
    """An answer, the state that it was computed for, and a lock for its computation."""

    def __init__(self) -> None:
        self.lock = Lock()
        self.state: Hashable = _NEVER
        self.answer: Any = None

    def holds_for(self, state: Hashable) -> bool:
        """Return whether the answer holds for a state; a result count also covers lower ones."""
        if isinstance(state, int) and isinstance(self.state, int):
            return self.state >= state
        return self.state == state


class AnswerCache:
    """The latest answers; each is computed once, however many threads ask for it.

    Args:
        most: number of answers that are kept; those that were asked for last stay.
    """

    def __init__(self, most: int = MOST_ANSWERS) -> None:
        self._most = most
        self._lock = Lock()
        self._entries: OrderedDict[Hashable, _Entry] = OrderedDict()

    def get(self, question: Hashable, state: Hashable, make: Callable[[], Answer]) -> Answer:
        """Return the answer to a question, computed unless it is known.

        Args:
            question: name and subject of the question.
            state: whatever changes when the answer does; read before the answer is computed. An
                answer of more results holds for fewer, so that two threads do not take turns.
            make: computes the answer.
        """
        entry = self._entry(question)
        # Each entry has a lock of its own: threads with the same question wait for one answer, and
        # other threads do not wait.
        with entry.lock:
            if not entry.holds_for(state):
                entry.answer, entry.state = make(), state
            answer: Answer = entry.answer
            return answer

    def known(self, question: Hashable, state: Hashable) -> Any:
        """Return the answer to a question if it is known, else None."""
        entry = self._entry(question)
        with entry.lock:
            return entry.answer if entry.holds_for(state) else None

    def put(self, question: Hashable, state: Hashable, answer: object) -> None:
        """Keep an answer that was computed elsewhere, with others in one query."""
        entry = self._entry(question)
        with entry.lock:
            if not entry.holds_for(state):
                entry.answer, entry.state = answer, state

    def _entry(self, question: Hashable) -> _Entry:
        with self._lock:
            entry = self._entries.pop(question, None) or _Entry()
            self._entries[question] = entry
            if len(self._entries) > self._most:
                self._entries.popitem(last=False)
            return entry


More = ParamSpec("More")


class _CountedCampaign(NamedTuple):
    """A campaign with the number of results that it had when it was read.

    While a page is made, sums use this number and do not ask the database again.
    """

    figures: "FigureStore"
    campaign: int
    results: int


# A context variable, as the sums of a page are computed in several threads.
_COUNTED: ContextVar[_CountedCampaign | None] = ContextVar("counted campaign", default=None)


class FigureStore(StorePart):
    """Sums over campaigns and their episodes, most from a cache while no result was added.

    A campaign that has ended is read once. A running campaign is read once for all simultaneous
    readers. The number of queries of a method does not depend on the number of campaigns.

    Args:
        database: the database of the campaigns.
        answers: the cache.
    """

    def __init__(self, database: Database, answers: AnswerCache) -> None:
        super().__init__(database)
        self._answers = answers
        # Of their own: a list of campaigns would push all other answers out.
        self._totals = AnswerCache(MOST_TOTALS)

    @contextmanager
    def as_of(self, campaign: Campaign) -> Iterator[None]:
        """Within the block, take the number of results from a campaign that was read before.

        Otherwise the sums of a running campaign would be computed again for each result that
        arrives between two questions of one page.
        """
        results = campaign.counts.completed + campaign.counts.errored
        token = _COUNTED.set(_CountedCampaign(self, campaign.id, results))
        try:
            yield
        finally:
            _COUNTED.reset(token)

    def totals(self, campaigns: Sequence[int]) -> dict[int, Totals]:
        """Return sums over failures, and episodes counted by the classes of `assess`; by campaign.

        All campaigns that are not in the cache are read in one query.
        """
        counts = self._count(campaigns)
        known = {each: self._totals.known(each, counts.get(each, 0)) for each in campaigns}
        missing = [each for each, found in known.items() if found is None]
        if missing:
            fresh = self._database.read(totals.sum_campaigns, missing)
            for each, found in fresh.items():
                self._totals.put(each, counts.get(each, 0), found)
            known |= fresh
        return known

    def course(self, campaign: int, per: int) -> list[summary.BlockTotals]:
        """Return sums over the completed episodes of each block of `per` indices, in order."""
        return self._ask_once(totals.sum_blocks, campaign, per)

    def safety(self, campaign: int, most: int = MOST_POINTS) -> SafetyTotals:
        """Return safety measures of the completed episodes, and at most `most` failures as points.

        If more failures have a severity, the points are every k-th of them in index order, from the
        first failure on. The smallest sufficient k is used.
        """
        return self._ask_once(totals.sum_safety, campaign, most)

    def spending(self, campaign: int, most: int = summary.MOST_LANDINGS) -> summary.SpendingTotals:
        """Return the worker time in the episodes, and when they landed.

        The progress consists of every k-th completed episode, by storage time and then by index,
        and of the last one. The smallest k that leaves at most `most` episodes is used.
        """
        return self._ask_once(totals.sum_spending, campaign, most)

    def samples(
        self, campaign: int, most: int = summary.MOST_SAMPLES
    ) -> tuple[summary.EpisodeSample, ...]:
        """Return at most `most` of the completed episodes, evenly spread, in index order.

        Their indices are multiples of k, for the smallest sufficient k up to the largest index that
        has a result.
        """
        return self._ask_once(_read_samples, campaign, most)

    def workers(self, campaign: int) -> tuple[WorkerShare, ...]:
        """Return the workers' shares in a campaign's episodes, the largest first, then by name."""
        return self._ask_once(_count_by_worker, campaign)

    def workers_since(self, at_ms: int) -> tuple[WorkerShare, ...]:
        """Return the shares of workers in the results since a moment, by campaign."""
        return self._database.read(_count_by_worker_since, at_ms)

    def pools(self) -> tuple[Pool, ...]:
        """Return sums over campaigns with equal peers and method, the newest first."""
        return self._database.read(_sum_pools)

    def _ask_once(
        self,
        question: Callable[Concatenate[sa.Connection, int, More], Answer],
        campaign: int,
        *more: More.args,
        **options: More.kwargs,
    ) -> Answer:
        """Return the answer to a query of a campaign's results."""
        key = (question.__name__, campaign, *more, *sorted(options.items()))
        ask = partial(self._database.read, question, campaign, *more, **options)
        # No connection is held meanwhile: those who wait for the answer need none.
        return self._answers.get(key, self._count([campaign]).get(campaign, 0), ask)

    def _count(self, campaigns: Sequence[int]) -> dict[int, int]:
        counted = _COUNTED.get()
        if counted and counted.figures is self and [*campaigns] == [counted.campaign]:
            return {counted.campaign: counted.results}
        return self._database.read(totals.count_results, campaigns)


def _read_samples(
    connection: sa.Connection, campaign: int, most: int
) -> tuple[summary.EpisodeSample, ...]:
    """Return the completed episodes whose index is a multiple of the smallest sufficient k."""
    inside = episodes.c.campaign == campaign
    reach = connection.execute(
        sa.select(sa.func.coalesce(sa.func.max(episode_index), -1)).where(inside)
    )
    every = max(1, ceil((reach.scalar_one() + 1) / most))
    query = (
        sa.select(episode_index, episodes.c.outcome, episodes.c.robustness_m)
        .where(inside, episode_index % every == 0, episodes.c.outcome != Outcome.ERRORED)
        .order_by(episode_index)
    )
    return tuple(
        summary.EpisodeSample(index, Outcome(outcome), robustness_m)
        for index, outcome, robustness_m in connection.execute(query)
    )


_PEERS = Peers.__struct_fields__


_BESIDES = (
    "settings",
    "episodes",
    "stop",
    "price_usd_per_hour",
    "instances",
    "scene_every",
    "importance",
    "planner_version",
)
"""Fields in which campaigns of one method and equal peers may still differ, beside the seed."""


_STRUCTURED = ("planner_settings", "scenario_parameters", "disturbance", "requirements")


def _select_pools() -> sa.Select[*tuple[Any, ...]]:
    ended = totals.select_unresolved().subquery()
    rules = (spec_field("stop.failures"), spec_field("stop.half_width"))
    judges_failures = sa.case((sa.and_(*(rule.is_(None) for rule in rules)), 0), else_=1)
    facts = (
        sa.select(
            *(spec_field(name).label(name) for name in (*_PEERS, "method")),
            campaigns.c.id,
            campaigns.c.completed,
            campaigns.c.failures,
            campaigns.c.failed,
            ended.c.unresolved,
            instance_hours.label("hours"),
            spent_usd.label("usd"),
            judges_failures.label("judges_failures"),
            spec_field("seed").label("seed"),
            _join_fields(_BESIDES).label("besides"),
        )
        .outerjoin(ended, ended.c.campaign == campaigns.c.id)
        .order_by(campaigns.c.id)
        .subquery()
        .c
    )
    same = [facts[name] for name in (*_PEERS, "method")]
    newest = sa.func.max(facts.id).label("newest")
    # The squares of counts below exceed the integers of PostgreSQL, which have 32 bits in these
    # columns.
    counted, crashes = facts.completed > 0, sa.cast(facts.failures, sa.Double)
    return (
        sa.select(
            *same,
            newest,
            sa.func.count().label("campaigns"),
            sa.func.sum(facts.completed).label("completed"),
            sa.func.sum(facts.failures).label("failures"),
            sa.func.sum(facts.failed).label("errored"),
            sa.func.coalesce(sa.func.sum(sa.cast(facts.unresolved, sa.Integer)), 0).label(
                "unresolved"
            ),
            sa.func.max(facts.judges_failures).label("judges_failures"),
            sa.func.sum(facts.hours).label("instance_hours"),
            sa.func.sum(facts.usd).label("total_usd"),
            sa.func.sum(facts.usd * facts.usd).label("usd_squares"),
            sa.func.sum(crashes * crashes).label("failure_squares"),
            sa.func.sum(facts.usd * crashes).label("usd_failures"),
            sa.func.count().filter(counted).label("seeds"),
            sa.func.count(facts.seed.distinct()).filter(counted).label("different"),
            sa.func.count(facts.besides.distinct()).filter(counted).label("kinds"),
            sa.func.count().filter(~counted, facts.usd > 0.0).label("in_vain"),
        )
        .group_by(*same)
        .order_by(newest.desc())
    )


def _join_fields(names: Sequence[str]) -> sa.ColumnElement[str]:
    """Return fields of a campaign's spec as one text, which is equal if all of them are equal."""
    texts = [sa.func.coalesce(sa.cast(spec_field(name), sa.String), "") for name in names]
    return reduce(lambda left, right: left + "|" + right, texts)


_POOLS = _select_pools()
"""Composed once: that takes 3 ms, and its execution over a thousand campaigns 7 ms."""


def _sum_pools(connection: sa.Connection) -> tuple[Pool, ...]:
    return tuple(_to_pool(dict(found)) for found in connection.execute(_POOLS).mappings())


def _to_pool(found: dict[str, Any]) -> Pool:
    given = {name: found.pop(name) for name in _PEERS}
    texts = {name: given[name] for name in _STRUCTURED}
    parts = {name: text and msgspec.json.decode(text) for name, text in texts.items()}
    found["judges_failures"] = bool(found["judges_failures"])
    different, kinds, in_vain = (found.pop(name) for name in ("different", "kinds", "in_vain"))
    # An interval across seeds needs campaigns that differ in their seeds alone. One that cost
    # something and completed nothing would be missing from it.
    if different < found["seeds"] or kinds > 1 or in_vain:
        found["seeds"] = 0
    return Pool(peers=msgspec.convert(given | parts, Peers), **found)


_SHARES = (
    sa.select(
        episodes.c.worker,
        episodes.c.campaign,
        sa.func.count().label("episodes"),
        sa.func.count().filter(is_failure).label("failures"),
        sa.func.count().filter(episodes.c.outcome == Outcome.ERRORED).label("errored"),
        sa.func.sum(episodes.c.wall_s).label("wall_s"),
        sa.func.max(episodes.c.finished_ms).label("last_ms"),
    )
    .group_by(episodes.c.worker, episodes.c.campaign)
    .order_by(sa.func.count().desc(), episodes.c.worker, episodes.c.campaign)
)


def _count_by_worker(connection: sa.Connection, campaign: int) -> tuple[WorkerShare, ...]:
    # Ordered by the time of storing, rows are read where they were written, one behind the other.
    inside = (episodes.c.campaign == campaign, episodes.c.finished_ms >= 0)
    return _read_shares(connection, _SHARES.where(*inside))


def _count_by_worker_since(connection: sa.Connection, at_ms: int) -> tuple[WorkerShare, ...]:
    """Count results since a moment by worker and campaign.

    Campaigns that ended before that moment are not read.
    """
    unended = sa.or_(campaigns.c.ended_ms.is_(None), campaigns.c.ended_ms >= at_ms)
    # Not a join: a database may begin one with the episodes, all of them.
    inside = episodes.c.campaign.in_(sa.select(campaigns.c.id).where(unended))
    return _read_shares(connection, _SHARES.where(inside, episodes.c.finished_ms >= at_ms))


def _read_shares(
    connection: sa.Connection, query: sa.Select[*tuple[Any, ...]]
) -> tuple[WorkerShare, ...]:
    return tuple(WorkerShare(**found) for found in connection.execute(query).mappings())
