"""Pruning: noise and scenes that are deleted to make room, and the record of it.

Noise is kept while a campaign or an analysis that has not ended needs it.
"""

from collections.abc import Collection
from typing import Any

import sqlalchemy as sa

from eigenfail.errors import Conflict
from eigenfail.values.analysis import AnalysisState
from eigenfail.values.campaign import FINAL_STATES, CampaignState
from eigenfail.values.episode import Outcome
from eigenfail.values.operations import Pruning, Retention, Weight
from eigenfail_services.resolution import NamedNoise
from eigenfail_services.store.campaign_rows import lock_campaign, read_campaign
from eigenfail_services.store.clock import now_ms
from eigenfail_services.store.codec import StructRows, to_references
from eigenfail_services.store.engine import StorePart, chunks
from eigenfail_services.store.errors import make_pruned_error, make_running_error
from eigenfail_services.store.events import append_event
from eigenfail_services.store.schema import (
    analyses,
    campaigns,
    episode_index,
    episodes,
    prunings,
    scenes,
    trajectories,
)

SLICE = 2_000
"""Episodes that lose their noise in one transaction, for which others who write have to wait.
"""

NOISE = (trajectories.c.campaign == episodes.c.campaign) & (
    trajectories.c["index"] == episode_index
)


def _select_prunable(
    campaign: int | sa.Column[int], rule: Retention | sa.sql.ColumnCollection[str, Any]
) -> sa.ColumnElement[bool]:
    """Select the episodes of a campaign that lose their noise to a rule: values, or columns."""
    # What is pruned and what a pruning explains must be the same: noise that is missing and that no
    # pruning explains counts as a defect.
    return sa.and_(
        episodes.c.campaign == campaign,
        episodes.c.outcome == Outcome.SAFE,
        episodes.c.source == rule.source,
        episode_index % rule.keep_every != 0,
    )


NOISE_PRUNED = (prunings.c.through >= episode_index) & _select_prunable(
    prunings.c.campaign, prunings.c
)
"""Whether an episode has lost its noise to a pruning: as `Pruning.took` says."""

_SCENE = (scenes.c.campaign == episodes.c.campaign) & (scenes.c["index"] == episode_index)
_BYTES = (
    sa.func.length(trajectories.c.z)
    + sa.func.length(trajectories.c.sigma)
    + sa.func.coalesce(sa.func.length(trajectories.c.states), 0)
    + sa.func.coalesce(sa.func.length(trajectories.c.importance), 0)
    + sa.func.coalesce(sa.func.length(scenes.c.scene), 0)
)
_HAS_SCENE = scenes.c.campaign.is_not(None)
_ROWS = StructRows(prunings, Pruning)

OPEN = frozenset(CampaignState) - FINAL_STATES
UNFINISHED = frozenset({AnalysisState.QUEUED, AnalysisState.RUNNING})


class RetentionStore(StorePart):
    """Pruning of noise and scenes; rows, failures and every k-th episode stay."""

    def weigh(self, campaign: int, rule: Retention) -> Weight:
        """Return what a rule would delete now.

        Raises:
            NotFound: no such campaign.
        """
        sums = (
            sa.func.count(),
            sa.func.count(scenes.c.campaign),
            sa.func.coalesce(sa.func.sum(_BYTES), 0),
        )
        query = _select_with_blobs(*sums).where(_select_prunable(campaign, rule))
        with self._database.reading() as connection:
            read_campaign(connection, campaign)
            counted, sights, size = connection.execute(query).one()
        return Weight(counted, sights, int(size))

    def prune(
        self, campaign: int, rule: Retention, who: str, begun: int | None = None
    ) -> Pruning | None:
        """Delete the next slice by a rule, in index order, and record it, all or nothing.

        Args:
            campaign: id of the campaign.
            rule: which episodes keep their noise.
            who: the user, in words, for the record.
            begun: id of the `Pruning` to continue; None begins one, with an event.

        Returns:
            The record so far; None if nothing (more) is to be deleted, and nothing was changed.

        Raises:
            NotFound: no such campaign.
            Conflict: the campaign has not ended, or its noise is in use: see `in_use`. No
                campaign that names it is created meanwhile.
        """
        with self._database.writing() as connection:
            subject = lock_campaign(connection, campaign)
            if subject.state not in FINAL_STATES:
                raise make_running_error(subject)
            # Creating a campaign or an analysis needs a lock on the campaigns that it names, so no
            # new use begins after this check.
            if campaign in find_noise_in_use(connection, campaign):
                raise Conflict(
                    "A campaign or an analysis that has not ended needs the noise of campaign "
                    f"{campaign}.",
                    "Wait for its end, or cancel it.",
                )
            found = _next_slice(connection, campaign, rule, begun)
            if not found:
                return None
            if begun is None:
                begun = _begin_pruning(connection, campaign, rule, who)
            _delete_blobs(connection, campaign, found)
            return _record_slice(connection, begun, found)

    def in_use(self) -> frozenset[int]:
        """Return the campaigns whose noise a running campaign or analysis still needs."""
        return self._database.read(find_noise_in_use)

    def of(self, campaign: int) -> tuple[Pruning, ...]:
        """Return the prunings of a campaign, oldest first."""
        query = sa.select(prunings).where(prunings.c.campaign == campaign).order_by(prunings.c.id)
        return self._database.read(_ROWS.list, query)


def _select_with_blobs(*columns: sa.ColumnElement[Any]) -> Any:
    return (
        sa.select(*columns)
        .select_from(episodes)
        .join(trajectories, NOISE)
        .outerjoin(scenes, _SCENE)
    )


def _next_slice(
    connection: sa.Connection, campaign: int, rule: Retention, begun: int | None
) -> list[Any]:
    """Return index, size and presence of a scene of the next episodes that lose their noise."""
    last = sa.select(sa.func.coalesce(sa.func.max(prunings.c.through), -1)).where(
        prunings.c.id == begun
    )
    query = (
        _select_with_blobs(episode_index, _BYTES.label("bytes"), _HAS_SCENE.label("has_scene"))
        .where(_select_prunable(campaign, rule), episode_index > last.scalar_subquery())
        .order_by(episode_index)
        .limit(SLICE)
    )
    return list(connection.execute(query))


def _begin_pruning(connection: sa.Connection, campaign: int, rule: Retention, who: str) -> int:
    values = {"campaign": campaign, "source": rule.source, "keep_every": rule.keep_every}
    nothing = {"through": -1, "episodes": 0, "scenes": 0, "bytes": 0}
    statement = sa.insert(prunings).values(pruned_ms=now_ms(), who=who, **values, **nothing)
    begun: int = connection.execute(statement.returning(prunings.c.id)).scalar_one()
    message = (
        f"{who} prunes campaign {campaign}: of its safe episodes with noise by {rule.source}, each "
        f"{rule.keep_every}th keeps noise and scene. All rows and all failures stay."
    )
    append_event(connection, "campaign.pruned", message, campaign)
    return begun


def _delete_blobs(connection: sa.Connection, campaign: int, found: list[Any]) -> None:
    indices = [row[0] for row in found]
    sights = [row[0] for row in found if row.has_scene]
    same = trajectories.c.campaign == campaign
    connection.execute(sa.delete(trajectories).where(same, trajectories.c["index"].in_(indices)))
    if sights:
        seen = (scenes.c.campaign == campaign, scenes.c["index"].in_(sights))
        connection.execute(sa.delete(scenes).where(*seen))
        # A row that still promised its scene would be a defect for `eigenfail db verify`.
        ours = (episodes.c.campaign == campaign, episode_index.in_(sights))
        connection.execute(sa.update(episodes).where(*ours).values(has_scene=False))


def _record_slice(connection: sa.Connection, begun: int, found: list[Any]) -> Pruning:
    # With the deletion, in one transaction: noise that is missing without a record is a defect.
    c = prunings.c
    statement = sa.update(prunings).where(c.id == begun)
    change = statement.values(
        through=found[-1][0],
        episodes=c.episodes + len(found),
        scenes=c.scenes + sum(1 for row in found if row.has_scene),
        bytes=c.bytes + sum(row.bytes for row in found),
    )
    (pruning,) = _ROWS.list(connection, change.returning(prunings))
    return pruning


def find_noise_in_use(connection: sa.Connection, campaign: int | None = None) -> frozenset[int]:
    """Return the campaigns whose noise a running campaign or analysis still needs.

    Args:
        connection: connection of a transaction that holds the campaign against new uses.
        campaign: if given, only analyses of this campaign are considered.
    """
    mine = () if campaign is None else (analyses.c.campaign == campaign,)
    read = sa.select(analyses.c.campaign).where(*mine, analyses.c.state.in_(UNFINISHED))
    named = sa.select(campaigns.c.references).where(campaigns.c.state.in_(OPEN))
    sources = [to_references(text).noise_sources for text in connection.execute(named).scalars()]
    return frozenset(connection.execute(read).scalars()).union(*sources)


def hold_noise(connection: sa.Connection, wanted: Collection[int]) -> None:
    """Keep these campaigns from losing noise until the transaction ends."""
    held = sa.select(campaigns.c.id).where(campaigns.c.id.in_(wanted)).order_by(campaigns.c.id)
    # A shared lock (FOR SHARE): several transactions may need the same noise, and a pruning, which
    # locks the row for itself, waits for all of them.
    connection.execute(held.with_for_update(read=True)).all()


def select_pruned_ms() -> sa.ScalarSelect[int]:
    """Select the time when an episode lost its noise; NULL if the noise is stored."""
    return (
        sa.select(sa.func.min(prunings.c.pruned_ms))
        .where(NOISE_PRUNED)
        .correlate(episodes)
        .scalar_subquery()
    )


def refuse_pruned(connection: sa.Connection, noise: NamedNoise) -> None:
    """Refuse noise of episodes that are named one by one, if it was pruned.

    Raises:
        NoisePruned: an episode that is named has lost its noise.
    """
    if noise.campaign is None:
        return
    found = sa.select(episode_index, episodes.c.source, select_pruned_ms().label("at_ms"))
    query = found.where(episodes.c.campaign == noise.campaign)
    for some in chunks(noise.indices):
        for index, source, at_ms in connection.execute(query.where(episode_index.in_(some))):
            if at_ms is not None:
                raise make_pruned_error(noise.campaign, index, source, at_ms)
