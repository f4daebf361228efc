"""Results of episodes in SQL: at most one for each, for good."""

import hashlib
from collections.abc import Iterable, Iterator, Sequence

from sqlalchemy import Connection, RowMapping, select

from eigenfail.filters import BY_INDEX, Conditions, Sort
from eigenfail.values import (
    BlockTotals,
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
    Delivery,
    EpisodeRow,
    Failures,
    Totals,
    Verdict,
)
from eigenfail.values.region import MOST_TRIALS
from eigenfail.values.safety import MOST_POINTS
from eigenfail.values.spending import MOST_LANDINGS
from eigenfail_services.store import deaths
from eigenfail_services.store.blocks import course, paired
from eigenfail_services.store.campaign_rows import locked, one
from eigenfail_services.store.codec import to_floats, to_result, to_row
from eigenfail_services.store.engine import Database
from eigenfail_services.store.episode_pages import number, pages
from eigenfail_services.store.landing import CHUNK, chunks, land
from eigenfail_services.store.refusals import no_episode, pruned
from eigenfail_services.store.remembered import Remembered
from eigenfail_services.store.retention import pruned_ms
from eigenfail_services.store.safety import safety
from eigenfail_services.store.schema import campaigns, episodes, scenes, trajectories
from eigenfail_services.store.spending import spending
from eigenfail_services.store.trials import trials

SAME_TRAJECTORY = (trajectories.c.campaign == episodes.c.campaign) & (
    trajectories.c["index"] == number
)
SAME_SCENE = (scenes.c.campaign == episodes.c.campaign) & (scenes.c["index"] == number)
RESULTS = (
    select(*episodes.c, campaigns.c.spec)
    .add_columns(trajectories.c.z, trajectories.c.sigma, trajectories.c.states)
    .select_from(episodes)
    .join(campaigns, campaigns.c.id == episodes.c.campaign)
    .outerjoin(trajectories, SAME_TRAJECTORY)
    .add_columns(pruned_ms().label("pruned_ms"))
)

ROWS = select(*episodes.c, pruned_ms().label("noise_pruned_ms"))


class SqlEpisodes:
    """Results, read and written."""

    def __init__(self, database: Database, remembered: Remembered) -> None:
        self._database = database
        self._remembered = remembered

    def commit(self, campaign: int, deliveries: Sequence[Delivery]) -> list[Verdict]:
        """Keep results, update the counts, and log alarms; one verdict for each delivery."""
        with self._database.writing() as connection:
            return land(connection, campaign, deliveries)

    def add_death(self, campaign: int, index: int) -> int:
        """One more worker was lost while it ran this episode; how many that makes.

        Raises:
            NotFound: no such campaign.
        """
        with self._database.writing() as connection:
            locked(connection, campaign)
            return deaths.add(connection, campaign, index)

    def get(self, campaign: int, index: int) -> EpisodeResult:
        """One result with everything that is kept of it."""
        query = (
            RESULTS.add_columns(scenes.c.scene)
            .outerjoin(scenes, SAME_SCENE)
            .where(episodes.c.campaign == campaign, number == index)
        )
        with self._database.reading() as connection:
            one(connection, campaign)
            found = connection.execute(query).mappings().one_or_none()
        if found is None or not is_there(found):
            raise no_episode(campaign, index)
        return to_result(found, found["scene"])

    def page(
        self,
        campaign: int,
        limit: int,
        after: int | None = None,
        where: Conditions = (),
        sort: Sort = BY_INDEX,
    ) -> Page[EpisodeRow]:
        """Episodes that fulfil all conditions, in an order, those behind `after`."""
        found: list[EpisodeRow] = []
        with self._database.reading() as connection:
            for query in pages(connection, campaign, after, where, sort):
                keys = query.limit(limit + 1 - len(found))
                found += _rows(connection, campaign, connection.execute(keys).scalars().all())
                if len(found) > limit:
                    break
        items = tuple(found[:limit])
        return Page(items, items[-1].index if len(found) > limit else None)

    def finished(self, campaign: int, indices: Iterable[int]) -> list[EpisodeResult]:
        """Those of the episodes that have a result, in index order, without their scenes."""
        query = RESULTS.where(episodes.c.campaign == campaign).order_by(number)
        with self._database.reading() as connection:
            return [
                to_result(found)
                for chunk in chunks(set(indices))
                for found in connection.execute(query.where(number.in_(chunk))).mappings()
                if is_there(found)
            ]

    def failures(self, campaign: int) -> Failures:
        """The noise of all collisions."""
        portions = list(self.failure_portions(campaign))
        return Failures(
            tuple(index for portion in portions for index in portion.indices),
            tuple(z for portion in portions for z in portion.noise),
        )

    def failure_portions(self, campaign: int) -> Iterator[Failures]:
        """The noise of all collisions, some at a time; all of one transaction."""
        query = (
            select(number, trajectories.c.z)
            .join(trajectories, SAME_TRAJECTORY)
            .where(episodes.c.campaign == campaign, episodes.c.outcome == Outcome.COLLISION)
            .order_by(number)
            .execution_options(yield_per=PORTION)
        )
        with self._database.reading() as connection:
            for rows_ in connection.execute(query).partitions():
                yield Failures(
                    tuple(index for index, _ in rows_), tuple(to_floats(z, 2) for _, z in rows_)
                )

    def totals(self, campaign: int) -> Totals:
        """Sums over all collisions, and episodes counted by class."""
        return self._remembered.totals([campaign])[campaign]

    def course(self, campaign: int, per: int) -> list[BlockTotals]:
        """Sums over blocks of `per` indices, in index order."""
        return self._remembered.once(course, campaign, per)

    def safety(self, campaign: int, most: int = MOST_POINTS) -> SafetyTotals:
        """Safety measures over the completed episodes, with at most so many points."""
        return self._remembered.once(safety, campaign, most)

    def trials(self, campaign: int, most: int = MOST_TRIALS) -> Trials:
        """Seeds and outcomes of the completed episodes, of at most so many."""
        with self._database.reading() as connection:
            return trials(connection, campaign, most)

    def spending(self, campaign: int, most: int = MOST_LANDINGS) -> SpendingTotals:
        """Worker time in the episodes, and when they landed."""
        return self._remembered.once(spending, campaign, most)

    def paired(self, first: int, second: int) -> PairTotals:
        """The episodes that two campaigns both completed."""
        with self._database.reading() as connection:
            return paired(connection, first, second)

    def digest(self, campaign: int) -> str:
        """SHA-256 over the digests of all results in index order."""
        with self._database.reading() as connection:
            return digest(connection, campaign)


def digest(connection: Connection, campaign: int) -> str:
    """SHA-256 over one line "index digest" for each result, in index order."""
    query = (
        select(number, episodes.c.digest)
        .where(episodes.c.campaign == campaign)
        .order_by(number)
        .execution_options(yield_per=CHUNK)
    )
    lines = hashlib.sha256()
    for index, known in connection.execute(query):
        lines.update(f"{index} {known}\n".encode())
    return lines.hexdigest()


def is_there(found: RowMapping) -> bool:
    """Whether the noise of an episode is; without it, and not pruned, it has no result either.

    Raises:
        NoisePruned: it was taken away.
    """
    if found["z"] is None and found["pruned_ms"] is not None:
        raise pruned(found["campaign"], found["index"], found["source"], found["pruned_ms"])
    return found["z"] is not None


def _rows(connection: Connection, campaign: int, indices: Sequence[int]) -> list[EpisodeRow]:
    """The rows of some episodes, in the order of these."""
    query = ROWS.where(episodes.c.campaign == campaign)
    found = {
        row["index"]: to_row(row)
        for chunk in chunks(set(indices))
        for row in connection.execute(query.where(number.in_(chunk))).mappings()
    }
    return [found[index] for index in indices]
