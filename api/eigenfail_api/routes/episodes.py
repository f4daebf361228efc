"""Routes of episodes: lists, single results, explanations, replays and exports as files."""

from collections.abc import Iterator
from typing import Annotated, Any

import msgspec
from fastapi import APIRouter, Depends, Query, Response
from fastapi.responses import StreamingResponse

from eigenfail import filters
from eigenfail.values.campaign import Campaign
from eigenfail.values.disturbance import find_channel_likelihoods
from eigenfail.values.episode import EpisodeResult, Outcome
from eigenfail.values.operations import Presence
from eigenfail.values.proof import Explanation
from eigenfail.values.records import EpisodeDetail, EpisodeRow, Page, assess
from eigenfail.wire.http import PREFIX, ReplayRequest
from eigenfail.worlds import list_channels
from eigenfail_api import parameters
from eigenfail_api.concurrency import ConcurrencyLimit, SerialExecutor
from eigenfail_api.openapi import document_file, document_route, problem_response
from eigenfail_services import export_formats
from eigenfail_services.campaigns.explanations import Explanations, replay_episode, write_steps
from eigenfail_services.campaigns.summary import find_worker

router = APIRouter(prefix=PREFIX, tags=["episodes"])

EPISODES = "/campaigns/{campaign}/episodes"

After = Annotated[
    int | None,
    Query(
        ge=0,
        le=parameters.LARGEST,
        description="Only episodes after this index in the sort order (`next` of a page).",
    ),
]
OnlyOutcome = Annotated[
    Outcome | None,
    Query(
        description="Only of this outcome: one more condition of the filter. `failed` means an "
        "errored episode; `errored` is accepted as well."
    ),
]
Filter = Annotated[
    str,
    Query(
        alias="filter",
        max_length=filters.LONGEST,
        description="Conditions joined by and, such as `severity > 80 and min_ttc_s < 1.5`.",
    ),
]
SortBy = Annotated[
    str,
    Query(
        alias="sort",
        description="A column, or -column for the largest first; missing values come last.",
    ),
]
Fields = Annotated[
    str,
    Query(
        description="Comma-separated names of columns: each item holds these alone, and "
        "is no EpisodeRow."
    ),
]


class EpisodeQuery(msgspec.Struct, frozen=True):
    """A filter of episodes, their order, and the columns to return; no columns stand for all."""

    where: filters.Conditions
    sort: filters.SortOrder
    columns: tuple[str, ...]


async def parse_query(
    outcome: OnlyOutcome = None,
    conditions: Filter = "",
    sort: SortBy = "index",
    fields: Fields = "",
) -> EpisodeQuery:
    """Return the query of a request."""
    where = (*filters.make_outcome_condition(outcome), *filters.parse_filter(conditions))
    return EpisodeQuery(where, filters.parse_sort(sort), filters.parse_fields(fields))


def read_page(
    limit: parameters.Limit = 100, after: After = None, with_total: parameters.WithTotal = False
) -> parameters.PageRequest:
    """Return the page that a request asks for."""
    return parameters.PageRequest(limit, after, with_total)


QueriedEpisodes = Annotated[EpisodeQuery, Depends(parse_query)]


@router.get(EPISODES, **document_route(Page[EpisodeRow]))
def list_episodes(
    store: parameters.Stored,
    campaign: parameters.CampaignId,
    query: QueriedEpisodes,
    asked: Annotated[parameters.PageRequest, Depends(read_page)],
) -> parameters.Json:
    """List finished episodes that match a filter, in index order or another."""
    # An unknown campaign is a 404, and one without matching episodes an empty list.
    store.campaigns.get(campaign)
    total = store.episodes.count(campaign, query.where) if asked.with_total else msgspec.UNSET
    found = store.episodes.page(campaign, asked.limit, asked.cursor, query.where, query.sort)
    if not query.columns:
        return parameters.Json(Page(found.items, found.next, total))
    items = tuple(export_formats.pick_columns(row, query.columns) for row in found.items)
    return parameters.Json(Page(items, found.next, total))


def make_episode_detail(
    campaign: int, result: EpisodeResult, channels: tuple[str, ...]
) -> EpisodeDetail:
    """Return the result with its campaign, assessment and the names of the channels of its noise.

    Args:
        campaign: id of its campaign.
        result: the result as it is stored.
        channels: names of the channels, in the order of the columns of z.
    """
    return EpisodeDetail(
        **msgspec.structs.asdict(result),
        assessed=assess(result.outcome, result.measures),
        channels=channels,
        likelihoods=find_channel_likelihoods(result.noise, channels),
        campaign=campaign,
    )


@router.get(f"{EPISODES}/{{index}}", **document_route(EpisodeDetail))
def get_episode(
    store: parameters.Stored, campaign: parameters.CampaignId, index: parameters.EpisodeIndex
) -> parameters.Json:
    """Get an episode with its class, noise and, where it was kept, its scene."""
    result = store.episodes.get(campaign, index)
    channels = list_channels(store.campaigns.get(campaign).spec)
    return parameters.Json(make_episode_detail(campaign, result, channels))


@router.get(f"{EPISODES}/{{index}}/worker", **document_route(Presence))
def get_episode_worker(
    store: parameters.Stored, campaign: parameters.CampaignId, index: parameters.EpisodeIndex
) -> parameters.Json:
    """Get the worker that ran an episode; a replay with other versions may differ."""
    return parameters.Json(find_worker(store, campaign, index))


# One at a time: each explanation runs an episode in a process of its own, for seconds.
EXPLAINING = SerialExecutor("explain")
EXPLANATIONS = Explanations()

STEPS_CSV = "text/csv; charset=utf-8"


@router.get(f"{EPISODES}/{{index}}/explanation", **document_route(Explanation))
async def get_explanation(
    store: parameters.Stored, campaign: parameters.CampaignId, index: parameters.EpisodeIndex
) -> parameters.Json:
    """Run an episode again from its noise, with the planner's account of each step."""
    return parameters.Json(await EXPLAINING.do(EXPLANATIONS.of, store, campaign, index))


@router.post(f"{EPISODES}/{{index}}/replay", **document_route(Campaign, 201, body=ReplayRequest))
def create_replay(
    store: parameters.Stored,
    campaign: parameters.CampaignId,
    index: parameters.EpisodeIndex,
    request: Annotated[ReplayRequest, Depends(parameters.body_of(ReplayRequest))],
    made_by: parameters.MadeBy,
) -> parameters.Json:
    """Queue a campaign that injects an episode's noise again, unchanged or scaled."""
    made = replay_episode(store, campaign, index, request.scale, made_by)
    return parameters.Json(made, 201, {"Location": f"{PREFIX}/campaigns/{made.id}"})


@router.get(
    f"{EPISODES}/{{index}}/steps",
    response_class=Response,
    responses={
        200: {"content": {STEPS_CSV: {"schema": {"type": "string"}}}},
        "default": problem_response(),
    },
)
def get_steps(
    store: parameters.Stored, campaign: parameters.CampaignId, index: parameters.EpisodeIndex
) -> Response:
    """Get the steps of an episode as CSV: noise and, where it was kept, the scene."""
    result = store.episodes.get(campaign, index)
    text = write_steps(result, list_channels(store.campaigns.get(campaign).spec))
    name = f'attachment; filename="episode-{campaign}-{index}.csv"'
    return Response(text, media_type=STEPS_CSV, headers={"Content-Disposition": name})


CSV, NDJSON, PARQUET = "text/csv", "application/x-ndjson", "application/vnd.apache.parquet"

WithNoise = Annotated[
    bool,
    Query(alias="noise", description="Whether each episode's z comes along, a column a channel."),
]


def make_source(
    store: parameters.Stored, campaign: parameters.CampaignId, query: QueriedEpisodes
) -> export_formats.ExportSource:
    """Return the episodes of a campaign that a request selects."""
    # This raises before the stream begins: after its first byte a stream cannot become an error.
    spec = store.campaigns.get(campaign).spec
    columns = query.columns or filters.list_columns(spec)
    selection = export_formats.Selection(query.where, query.sort, columns)
    return export_formats.ExportSource(store, campaign, selection)


Source = Annotated[export_formats.ExportSource, Depends(make_source)]

# A portion of episodes with their noise takes a second and much memory to encode.
EXPORTS = ConcurrencyLimit("exports")
EXPORTED: dict[str, Any] = {
    "response_class": StreamingResponse,
    "dependencies": [Depends(EXPORTS, scope="function")],
}


@router.get("/campaigns/{campaign}/episodes.csv", **EXPORTED, **document_file(CSV))
def stream_csv(source: Source) -> StreamingResponse:
    """Get finished episodes as CSV; text that a spreadsheet would compute begins with a '."""
    return _stream(source, export_formats.write_csv(source), CSV, "csv")


@router.get("/campaigns/{campaign}/episodes.ndjson", **EXPORTED, **document_file(NDJSON))
def stream_ndjson(source: Source) -> StreamingResponse:
    """Get finished episodes, one JSON object per line."""
    return _stream(source, export_formats.write_ndjson(source), NDJSON, "ndjson")


@router.get("/campaigns/{campaign}/episodes.parquet", **EXPORTED, **document_file(PARQUET))
def stream_parquet(source: Source, with_noise: WithNoise = False) -> StreamingResponse:
    """Get finished episodes as Parquet, with their noise if asked."""
    export_formats.require_pyarrow()
    content = export_formats.write_parquet(source, noise=with_noise)
    return _stream(source, content, PARQUET, "parquet")


def _stream(
    source: export_formats.ExportSource, content: Iterator[bytes], kind: str, suffix: str
) -> StreamingResponse:
    headers = {"Content-Disposition": f'attachment; filename="campaign-{source.campaign}.{suffix}"'}
    return StreamingResponse(EXPORTS.stream(content), media_type=kind, headers=headers)
