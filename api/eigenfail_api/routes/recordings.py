"""Routes of recordings: episodes and failure modes as files of other tools."""

from typing import Annotated, Any

from fastapi import APIRouter, Query, Response

from eigenfail.contracts.recording import ANIMATION, EgoControl
from eigenfail.wire.http import PREFIX
from eigenfail_api.concurrency import SerialExecutor
from eigenfail_api.openapi import document_file
from eigenfail_api.parameters import AnalysisId, CampaignId, EpisodeIndex, ModeNumber, Stored
from eigenfail_api.routes.episodes import EXPLANATIONS
from eigenfail_services.campaigns import recordings
from eigenfail_services.store.store import Store

router = APIRouter(prefix=PREFIX)

RECORDING = SerialExecutor("record")
"""Files are made one at a time: each occupies a core for seconds, and memory."""

FormatName = Annotated[
    str,
    Query(
        alias="format",
        description="`openscenario`: a ZIP archive of scenario, road and noise; `mcap`: a log for "
        "Foxglove; `gif`: an animation. Plug-ins bring these and other formats.",
    ),
]
OverlayName = Annotated[
    str, Query(alias="format", description="Format that shows several episodes over each other.")
]
Ego = Annotated[
    EgoControl,
    Query(
        description="`recorded`: the ego repeats its course; `controller`: it is left to a "
        "controller of the simulator (`openscenario` only)."
    ),
]

FILE: dict[str, Any] = {"response_class": Response, **document_file("*/*")}


def _make_download(file: recordings.RecordingFile, name: str) -> Response:
    headers = {"Content-Disposition": f'attachment; filename="{name}{file.form.suffix}"'}
    return Response(file.content, media_type=file.form.media_type, headers=headers)


@router.get("/campaigns/{campaign}/episodes/{index}/recording", tags=["episodes"], **FILE)
async def get_recording(
    store: Stored,
    campaign: CampaignId,
    index: EpisodeIndex,
    form: FormatName,
    ego: Ego = EgoControl.RECORDED,
) -> Response:
    """Get an episode as OpenSCENARIO, MCAP or GIF; one without a scene is run again."""
    episode = (campaign, index)
    file = await RECORDING.do(
        recordings.make_recording_file, store, EXPLANATIONS, episode, form, ego
    )
    return _make_download(file, f"episode-{campaign}-{index}")


@router.get("/analyses/{analysis}/modes/{mode}/animation", tags=["analyses"], **FILE)
async def get_mode_animation(
    store: Stored, analysis: AnalysisId, mode: ModeNumber, form: OverlayName = ANIMATION
) -> Response:
    """Get the failures of a mode, drawn over each other, as an animated GIF."""
    file = await RECORDING.do(_animate_mode, store, analysis, mode, form)
    return _make_download(file, f"analysis-{analysis}-mode-{mode}")


def _animate_mode(store: Store, analysis: int, mode: int, form: str) -> recordings.RecordingFile:
    # The analysis is read here, in the thread of the work: the event loop must not wait for the
    # database.
    return recordings.make_mode_animation(store, store.analyses.get(analysis), mode, form)
