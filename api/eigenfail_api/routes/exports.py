"""Episodes as files: text as it is read, Parquet made first and fetched then."""

from collections.abc import Callable, Iterator
from typing import Annotated, Any

from fastapi import APIRouter, Depends, Path, Request
from fastapi.responses import FileResponse, StreamingResponse

from eigenfail.contracts import Store
from eigenfail.filters import COLUMNS
from eigenfail.values.export import Export, ExportRequest
from eigenfail.wire.http import PREFIX
from eigenfail_api.bodies import Json, body_of
from eigenfail_api.parameters import EXPORT, CampaignId, Stored
from eigenfail_api.routes.episodes import Wanted, WantedEpisodes
from eigenfail_api.schemas import documented, refusal
from eigenfail_services.exports.jobs import ExportJobs
from eigenfail_services.exports.lines import csv_lines, ndjson
from eigenfail_services.exports.selection import Selection, Source

router = APIRouter(prefix=PREFIX, tags=["episodes"])

CSV, NDJSON = "text/csv", "application/x-ndjson"
PARQUET = "application/vnd.apache.parquet"

ExportId = Annotated[str, Path(pattern=EXPORT, description="Id of an export.")]
Lines = Callable[[Source], Iterator[bytes]]


def file_of(kind: str) -> dict[str, Any]:
    """What OpenAPI is told of a route that answers with a file."""
    content = {kind: {"schema": {"type": "string", "format": "binary"}}}
    return {"responses": {200: {"content": content}, "default": refusal()}}


async def exports_of(request: Request) -> ExportJobs:
    """The files that are made here."""
    jobs: ExportJobs = request.app.state.exports
    return jobs


Jobs = Annotated[ExportJobs, Depends(exports_of)]


@router.get("/campaigns/{campaign}/episodes.csv", response_class=StreamingResponse, **file_of(CSV))
def stream_csv(store: Stored, campaign: CampaignId, wanted: WantedEpisodes) -> StreamingResponse:
    """Finished episodes as a table; texts that a spreadsheet would compute begin with a '."""
    return streamed(store, campaign, wanted, csv_lines, CSV)


@router.get(
    "/campaigns/{campaign}/episodes.ndjson", response_class=StreamingResponse, **file_of(NDJSON)
)
def stream_ndjson(store: Stored, campaign: CampaignId, wanted: WantedEpisodes) -> StreamingResponse:
    """Finished episodes, one JSON object a line."""
    return streamed(store, campaign, wanted, ndjson, NDJSON)


def streamed(
    store: Store, campaign: int, wanted: Wanted, lines: Lines, kind: str
) -> StreamingResponse:
    """The lines as they are read, under a file's name."""
    store.campaigns.get(campaign)
    selection = Selection(wanted.where, wanted.sort, wanted.columns or tuple(COLUMNS))
    source = Source(store, campaign, selection)
    suffix = {CSV: "csv", NDJSON: "ndjson"}[kind]
    named = {"Content-Disposition": f'attachment; filename="campaign-{campaign}.{suffix}"'}
    return StreamingResponse(lines(source), media_type=kind, headers=named)


@router.post("/campaigns/{campaign}/exports", **documented(Export, 202, body=ExportRequest))
def create_export(
    jobs: Jobs,
    campaign: CampaignId,
    request: Annotated[ExportRequest, Depends(body_of(ExportRequest))],
) -> Json:
    """Have a Parquet file made of finished episodes."""
    export = jobs.create(campaign, request)
    return Json(export, 202, {"Location": f"{PREFIX}/exports/{export.id}"})


@router.get("/exports/{export}", **documented(Export))
def get_export(jobs: Jobs, export: ExportId) -> Json:
    """How far a file is; what a killed service left unfinished is begun anew."""
    return Json(jobs.get(export))


@router.get("/exports/{export}/file", response_class=FileResponse, **file_of(PARQUET))
def get_export_file(jobs: Jobs, export: ExportId) -> FileResponse:
    """The file, once it is done."""
    path = jobs.file(export)
    return FileResponse(path, media_type=PARQUET, filename=f"export-{export[:8]}.parquet")
