"""References to campaigns and episodes, and which of these have lost their noise.

Settings name campaigns whose noise is injected or learnt from, and analyses read it.
"""

from collections.abc import Collection, Iterable, Iterator, Mapping
from typing import Any

import msgspec
import sqlalchemy as sa

from eigenfail.values.analysis import AnalysisState
from eigenfail.values.campaign import FINAL_STATES, CampaignState
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.episode import Outcome
from eigenfail_services.store.engine import chunks
from eigenfail_services.store.errors import make_pruned_error
from eigenfail_services.store.schema import (
    MAX_NUMBER,
    analyses,
    campaigns,
    episode_index,
    episodes,
    prunings,
)

NAMING = frozenset({"campaign", "data_from"})
"""Settings of methods that name campaigns whose noise is injected or learnt from."""

OPEN = frozenset(CampaignState) - FINAL_STATES
UNFINISHED = frozenset({AnalysisState.QUEUED, AnalysisState.RUNNING})


class Named(msgspec.Struct, frozen=True):
    """The part of a spec that may name campaigns."""

    settings: Mapping[str, Any] = {}


_named = msgspec.json.Decoder(Named)


def find_named_episodes(settings: Mapping[str, Any]) -> tuple[int | None, set[int]]:
    """Return the campaign, and those of its episodes, that settings name one by one.

    Settings of a plug-in's method may have the same names, and any type and meaning.
    """
    campaign = next(_ids([settings.get("campaign")]), None)
    return campaign, {*_ids(settings.get("episode")), *_ids(settings.get("episodes"))}


def find_named_campaigns(settings: Mapping[str, Any]) -> Iterator[int]:
    """Yield the campaigns that settings name, including those of an ensemble's members."""
    for name, value in settings.items():
        if isinstance(value, Mapping):
            yield from find_named_campaigns(value)
        if name in NAMING:
            yield from _ids(value)


def _ids(value: Any) -> Iterator[int]:
    found = value if isinstance(value, list | tuple) else [value]
    # `isinstance` would accept True, which is not an id.
    return (each for each in found if type(each) is int and 0 <= each <= MAX_NUMBER)


def find_noise_in_use(connection: sa.Connection, campaign: int | None = None) -> frozenset[int]:
    """Return the campaigns whose noise a running campaign or analysis still needs.

    Args:
        connection: connection of a transaction that holds the campaign against new uses.
        campaign: if given, only analyses of this campaign are considered.
    """
    mine = () if campaign is None else (analyses.c.campaign == campaign,)
    read = sa.select(analyses.c.campaign).where(*mine, analyses.c.state.in_(UNFINISHED))
    # Most specs name no campaign, and need not be read.
    naming = sa.or_(*(campaigns.c.spec.contains(f'"{name}"') for name in sorted(NAMING)))
    specs = sa.select(campaigns.c.spec).where(campaigns.c.state.in_(OPEN), naming)
    named = (_named.decode(text).settings for text in connection.execute(specs).scalars())
    return frozenset(connection.execute(read).scalars()).union(*map(find_named_campaigns, named))


def hold_named_noise(connection: sa.Connection, specs: Iterable[CampaignSpec]) -> None:
    """Keep campaigns that new ones name from losing noise until the new ones are visible."""
    if wanted := {number for spec in specs for number in find_named_campaigns(spec.settings)}:
        hold_noise(connection, wanted)


def hold_noise(connection: sa.Connection, wanted: Collection[int]) -> None:
    """Keep these campaigns from losing noise until the transaction ends."""
    held = sa.select(campaigns.c.id).where(campaigns.c.id.in_(wanted)).order_by(campaigns.c.id)
    # A shared lock (FOR SHARE): several transactions may need the same noise, and a pruning, which
    # locks the row for itself, waits for all of them.
    connection.execute(held.with_for_update(read=True)).all()


NOISE_PRUNED = sa.and_(
    prunings.c.campaign == episodes.c.campaign,
    prunings.c.through >= episode_index,
    episodes.c.outcome == Outcome.SAFE,
    episodes.c.source == prunings.c.source,
    episode_index % prunings.c.keep_every != 0,
)
"""Whether an episode has lost its noise to a pruning: as `Pruning.took` says."""


def select_pruned_ms() -> sa.ScalarSelect[int]:
    """Select the time when an episode lost its noise; NULL if the noise is stored."""
    return (
        sa.select(sa.func.min(prunings.c.pruned_ms))
        .where(NOISE_PRUNED)
        .correlate(episodes)
        .scalar_subquery()
    )


def refuse_pruned(connection: sa.Connection, specs: Iterable[CampaignSpec]) -> None:
    """Refuse specs that name an episode whose noise was pruned.

    Raises:
        NoisePruned: an episode that a spec names has lost its noise.
    """
    for campaign, indices in (find_named_episodes(spec.settings) for spec in specs):
        found = sa.select(episode_index, episodes.c.source, select_pruned_ms().label("at_ms"))
        query = found.where(episodes.c.campaign == campaign)
        for some in chunks(indices):
            for index, source, at_ms in connection.execute(query.where(episode_index.in_(some))):
                if at_ms is not None:
                    raise make_pruned_error(campaign or 0, index, source, at_ms)
