"""Noise and scenes that go to make room, and the record of what is gone, in SQL."""

from collections.abc import Iterable
from typing import Any

from sqlalchemy import (
    ColumnElement,
    Connection,
    ScalarSelect,
    and_,
    delete,
    func,
    insert,
    select,
    update,
)
from sqlalchemy.engine import RowMapping

from eigenfail.values import FINAL_STATES, CampaignSpec, Outcome
from eigenfail.values.retention import Pruning, Retention, Weight
from eigenfail_services.store import sentences
from eigenfail_services.store.campaign_rows import locked, one
from eigenfail_services.store.clock import now_ms
from eigenfail_services.store.engine import Database
from eigenfail_services.store.events import append
from eigenfail_services.store.landing import chunks
from eigenfail_services.store.naming import episodes_of, in_use
from eigenfail_services.store.refusals import not_ended, pruned, still_needed
from eigenfail_services.store.schema import episodes, prunings, scenes, trajectories

SLICE = 2_000
"""Episodes that lose their noise in one transaction: others who write wait for less than a second.
"""

number = episodes.c["index"]
NOISE = (trajectories.c.campaign == episodes.c.campaign) & (trajectories.c["index"] == number)
SCENE = (scenes.c.campaign == episodes.c.campaign) & (scenes.c["index"] == number)
BYTES = (
    func.length(trajectories.c.z)
    + func.length(trajectories.c.sigma)
    + func.coalesce(func.length(trajectories.c.states), 0)
    + func.coalesce(func.length(scenes.c.scene), 0)
)
HAS_SCENE = scenes.c.campaign.is_not(None)

TAKEN = and_(
    prunings.c.campaign == episodes.c.campaign,
    prunings.c.through >= number,
    episodes.c.outcome == Outcome.SAFE,
    episodes.c.source == prunings.c.source,
    number % prunings.c.keep_every != 0,
)
"""Whether an episode has lost its noise to a pruning: as `Pruning.took` says."""


def pruned_ms() -> ScalarSelect[int]:
    """When an episode lost its noise, beside its row; nothing where it is kept."""
    return select(func.min(prunings.c.pruned_ms)).where(TAKEN).correlate(episodes).scalar_subquery()


class SqlRetention:
    """Takes blobs away, slice by slice."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def weigh(self, campaign: int, rule: Retention) -> Weight:
        """What goes by a rule, if it is applied now."""
        sums = (func.count(), func.count(scenes.c.campaign), func.coalesce(func.sum(BYTES), 0))
        query = with_blobs(*sums).where(*losable(campaign, rule))
        with self._database.reading() as connection:
            one(connection, campaign)
            counted, sights, size = connection.execute(query).one()
        return Weight(counted, sights, int(size))

    def prune(
        self, campaign: int, rule: Retention, who: str, begun: int | None = None
    ) -> Pruning | None:
        """Take away the next slice, and record it."""
        with self._database.writing() as connection:
            subject = locked(connection, campaign)
            if subject.state not in FINAL_STATES:
                raise not_ended(subject)
            if campaign in in_use(connection, campaign):
                raise still_needed(campaign)
            found = next_slice(connection, campaign, rule, begun)
            if not found:
                return None
            if begun is None:
                begun = begin(connection, campaign, rule, who)
            take(connection, campaign, found)
            return recorded(connection, begun, found)

    def in_use(self) -> frozenset[int]:
        """Campaigns whose noise others need that have not ended."""
        with self._database.reading() as connection:
            return in_use(connection)

    def of(self, campaign: int) -> tuple[Pruning, ...]:
        """What was taken from a campaign, oldest first."""
        query = select(prunings).where(prunings.c.campaign == campaign).order_by(prunings.c.id)
        with self._database.reading() as connection:
            return tuple(map(to_pruning, connection.execute(query).mappings()))


def with_blobs(*columns: ColumnElement[Any]) -> Any:
    """A question about episodes whose noise is there, and their scenes."""
    return select(*columns).select_from(episodes).join(trajectories, NOISE).outerjoin(scenes, SCENE)


def losable(campaign: int, rule: Retention) -> tuple[ColumnElement[bool], ...]:
    """What a rule takes of a campaign."""
    return (
        episodes.c.campaign == campaign,
        episodes.c.outcome == Outcome.SAFE,
        episodes.c.source == rule.source,
        number % rule.keep_every != 0,
    )


def next_slice(
    connection: Connection, campaign: int, rule: Retention, begun: int | None
) -> list[Any]:
    """Index, size and whether there is a scene, of the next episodes that lose their noise."""
    last = select(func.coalesce(func.max(prunings.c.through), -1)).where(prunings.c.id == begun)
    query = (
        with_blobs(number, BYTES.label("bytes"), HAS_SCENE.label("has_scene"))
        .where(*losable(campaign, rule), number > last.scalar_subquery())
        .order_by(number)
        .limit(SLICE)
    )
    return list(connection.execute(query))


def begin(connection: Connection, campaign: int, rule: Retention, who: str) -> int:
    """A record that nothing is gone as yet, and an event."""
    values = {"campaign": campaign, "source": rule.source, "keep_every": rule.keep_every}
    nothing = {"through": -1, "episodes": 0, "scenes": 0, "bytes": 0}
    statement = insert(prunings).values(pruned_ms=now_ms(), who=who, **values, **nothing)
    begun: int = connection.execute(statement.returning(prunings.c.id)).scalar_one()
    append(connection, "campaign.pruned", sentences.pruning(campaign, rule, who), campaign)
    return begun


def take(connection: Connection, campaign: int, found: list[Any]) -> None:
    """Away with the blobs."""
    indices = [row[0] for row in found]
    sights = [row[0] for row in found if row.has_scene]
    same = trajectories.c.campaign == campaign
    connection.execute(delete(trajectories).where(same, trajectories.c["index"].in_(indices)))
    if sights:
        seen = (scenes.c.campaign == campaign, scenes.c["index"].in_(sights))
        connection.execute(delete(scenes).where(*seen))
        ours = (episodes.c.campaign == campaign, number.in_(sights))
        connection.execute(update(episodes).where(*ours).values(has_scene=False))


def recorded(connection: Connection, begun: int, found: list[Any]) -> Pruning:
    """The record, with a slice more."""
    c = prunings.c
    statement = update(prunings).where(c.id == begun)
    change = statement.values(
        through=found[-1][0],
        episodes=c.episodes + len(found),
        scenes=c.scenes + sum(1 for row in found if row.has_scene),
        bytes=c.bytes + sum(row.bytes for row in found),
    )
    return to_pruning(connection.execute(change.returning(prunings)).mappings().one())


def to_pruning(found: RowMapping) -> Pruning:
    """A record from its row."""
    values = dict(found)
    rule = Retention(values.pop("keep_every"), values.pop("source"))
    weight = Weight(values.pop("episodes"), values.pop("scenes"), values.pop("bytes"))
    return Pruning(retention=rule, weight=weight, **values)


def refuse_gone(connection: Connection, specs: Iterable[CampaignSpec]) -> None:
    """Raises NoisePruned if an episode that a new campaign names has lost its noise."""
    for campaign, indices in (episodes_of(spec.settings) for spec in specs):
        found = select(number, episodes.c.source, pruned_ms().label("at_ms"))
        query = found.where(episodes.c.campaign == campaign)
        for some in chunks(indices):
            for index, source, at_ms in connection.execute(query.where(number.in_(some))):
                if at_ms is not None:
                    raise pruned(campaign or 0, index, source, at_ms)
