"""Episodes of a campaign: a list without trajectories, one with all that is kept of it."""

from typing import Annotated

import msgspec
from fastapi import APIRouter, Depends, Query

from eigenfail.filters import Conditions, Sort, outcome_is, parse_fields, parse_filter, parse_sort
from eigenfail.filters.parser import LONGEST
from eigenfail.values import Outcome, Page
from eigenfail.values.records import EpisodeDetail, EpisodeRow, detailed
from eigenfail.values.worker import Presence
from eigenfail.wire.http import PREFIX
from eigenfail_api.bodies import Json
from eigenfail_api.parameters import LARGEST, CampaignId, EpisodeIndex, Limit, Stored
from eigenfail_api.schemas import documented
from eigenfail_services.campaigns.crew import who_ran
from eigenfail_services.exports.selection import picked

router = APIRouter(prefix=f"{PREFIX}/campaigns/{{campaign}}/episodes", tags=["episodes"])

After = Annotated[
    int | None,
    Query(
        ge=0,
        le=LARGEST,
        description="Only those behind this index in the order: `next` of a page.",
    ),
]
OnlyOutcome = Annotated[
    Outcome | None, Query(description="Only of this outcome: one more condition of the filter.")
]
Filter = Annotated[
    str,
    Query(
        alias="filter",
        max_length=LONGEST,
        description="Conditions joined by and, such as `severity > 80 and min_ttc_s < 1.5`.",
    ),
]
SortBy = Annotated[
    str,
    Query(
        alias="sort",
        description="A column, or -column for the largest first; without a value they come last.",
    ),
]
Fields = Annotated[
    str,
    Query(
        description="Names of columns with commas in between: each item holds these alone, and "
        "is no EpisodeRow."
    ),
]


class Wanted(msgspec.Struct, frozen=True):
    """Which episodes are wanted, in which order, and which columns; none stand for all."""

    where: Conditions
    sort: Sort
    columns: tuple[str, ...]


async def wanted_of(
    outcome: OnlyOutcome = None,
    conditions: Filter = "",
    sort: SortBy = "index",
    fields: Fields = "",
) -> Wanted:
    """What was asked for."""
    where = (*outcome_is(outcome), *parse_filter(conditions))
    return Wanted(where, parse_sort(sort), parse_fields(fields))


WantedEpisodes = Annotated[Wanted, Depends(wanted_of)]


@router.get("", **documented(Page[EpisodeRow]))
def list_episodes(
    store: Stored,
    campaign: CampaignId,
    wanted: WantedEpisodes,
    limit: Limit = 100,
    after: After = None,
) -> Json:
    """Finished episodes that fulfil a filter, in index order or another."""
    store.campaigns.get(campaign)
    found = store.episodes.page(campaign, limit, after, wanted.where, wanted.sort)
    if not wanted.columns:
        return Json(found)
    items = tuple(picked(row, wanted.columns) for row in found.items)
    return Json(Page(items, found.next))


@router.get("/{index}", **documented(EpisodeDetail))
def get_episode(store: Stored, campaign: CampaignId, index: EpisodeIndex) -> Json:
    """One result with its class, its noise and, where it was kept, its scene."""
    return Json(detailed(store.episodes.get(campaign, index)))


@router.get("/{index}/worker", **documented(Presence))
def get_episode_worker(store: Stored, campaign: CampaignId, index: EpisodeIndex) -> Json:
    """Who ran an episode, where, and with which versions: a replay with others may differ."""
    return Json(who_ran(store, campaign, index))
