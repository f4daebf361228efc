"""Routes of recordings: episodes and failure modes as files of other tools."""

from typing import Annotated, Any

from fastapi import APIRouter, Query, Response

from eigenfail.exchange.recording import EgoControl, RecordingFormat
from eigenfail.wire.http import PREFIX
from eigenfail_api.concurrency import SerialExecutor
from eigenfail_api.openapi import problem_response
from eigenfail_api.parameters import AnalysisId, CampaignId, EpisodeIndex, ModeNumber, Stored
from eigenfail_api.routes.episodes import EXPLANATIONS
from eigenfail_services.campaigns.recordings import make_mode_animation, make_recording_file
from eigenfail_services.store import Store

router = APIRouter(prefix=PREFIX)

RECORDING = SerialExecutor("record")
"""Files are made one at a time: each occupies a core for seconds, and memory."""

MEDIA = {
    RecordingFormat.OPENSCENARIO: "application/zip",
    RecordingFormat.MCAP: "application/octet-stream",
    RecordingFormat.GIF: "image/gif",
}

AsRecording = Annotated[
    RecordingFormat,
    Query(
        alias="format",
        description="`openscenario`: a ZIP archive of scenario, road and noise; `mcap`: a log for "
        "Foxglove; `gif`: an animation.",
    ),
]
Ego = Annotated[
    EgoControl,
    Query(
        description="`recorded`: the ego repeats its course; `controller`: it is left to a "
        "controller of the simulator (`openscenario` only)."
    ),
]


def _document_files(*kinds: str) -> dict[str, Any]:
    content = {kind: {"schema": {"type": "string", "format": "binary"}} for kind in kinds}
    return {
        "response_class": Response,
        "responses": {200: {"content": content}, "default": problem_response()},
    }


def _make_download(content: bytes, form: RecordingFormat, name: str) -> Response:
    headers = {"Content-Disposition": f'attachment; filename="{name}{form.suffix}"'}
    return Response(content, media_type=MEDIA[form], headers=headers)


@router.get(
    "/campaigns/{campaign}/episodes/{index}/recording",
    tags=["episodes"],
    **_document_files(*MEDIA.values()),
)
async def get_recording(
    store: Stored,
    campaign: CampaignId,
    index: EpisodeIndex,
    format_: AsRecording,
    ego: Ego = EgoControl.RECORDED,
) -> Response:
    """Get an episode as OpenSCENARIO, MCAP or GIF; one without a scene is run again."""
    episode = (campaign, index)
    content = await RECORDING.do(make_recording_file, store, EXPLANATIONS, episode, format_, ego)
    return _make_download(content, format_, f"episode-{campaign}-{index}")


@router.get(
    "/analyses/{analysis}/modes/{mode}/animation",
    tags=["analyses"],
    **_document_files(MEDIA[RecordingFormat.GIF]),
)
async def get_mode_animation(store: Stored, analysis: AnalysisId, mode: ModeNumber) -> Response:
    """Get the failures of a mode, drawn over each other, as an animated GIF."""
    content = await RECORDING.do(_animate_mode, store, analysis, mode)
    return _make_download(content, RecordingFormat.GIF, f"analysis-{analysis}-mode-{mode}")


def _animate_mode(store: Store, analysis: int, mode: int) -> bytes:
    return make_mode_animation(store, store.analyses.get(analysis), mode)
