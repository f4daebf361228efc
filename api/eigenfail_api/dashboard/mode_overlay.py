"""The failures of a mode over each other in one scene, for the player of its page."""

from collections.abc import Iterator, Sequence
from math import ceil, inf

import msgspec
import numpy as np
from fastapi import APIRouter, Depends
from fastapi.responses import HTMLResponse
from numpy.typing import NDArray

from eigenfail.contracts.recording import OverlaidRecordings
from eigenfail.errors import Conflict
from eigenfail.presentation.figures import UNKNOWN, format_number
from eigenfail.values.episode import Outcome
from eigenfail.values.scene import Scene
from eigenfail_api.concurrency import ConcurrencyLimit
from eigenfail_api.dashboard.charts import Chart, list_rows, round_rows
from eigenfail_api.dashboard.rendering import page
from eigenfail_api.dashboard.scene import CONVENTIONAL_LANE_M
from eigenfail_api.parameters import AnalysisId, ModeNumber, Stored
from eigenfail_services.analysis.footprints import find_struck, measure_clearances
from eigenfail_services.campaigns.proofs import read_result
from eigenfail_services.campaigns.recordings import OverlayBounds, load_mode_recordings

BOUNDS = OverlayBounds(episodes=100, drawn_poses=500_000, kept_poses=100_000)
"""100,000 poses are about 2 MB of the page, and 100 failures are drawn in the time of a frame."""

CENTIMETRE, MILLIRADIAN = 2, 3
"""Decimals of positions and headings: finer than a screen shows."""

TABLE_STEP_S = 0.5
"""Time between two rows of the table. [s]"""

MOST_TABLE_ROWS = 60
"""Rows of the table at most; of longer episodes it has fewer moments."""


def describe_first(recordings: OverlaidRecordings) -> str:
    """Return which failure is opaque: the medoid, or an episode if the medoid has no scene."""
    campaign, index = recordings.episodes[0]
    return "the medoid" if recordings.has_medoid else f"episode {campaign}/{index}"


def make_overlay_chart(recordings: OverlaidRecordings, name: str) -> Chart:
    """Return the courses of episodes over each other, and a table of them by time."""
    failures = [_Failure(scene) for scene in recordings.scenes]
    mission, first = recordings.mission, describe_first(recordings)
    data: dict[str, object] = {
        "dt": recordings.scenes[0].dt_s,
        "last": max(each.last for each in failures),
        "lanes": mission.lanes if mission else 0,
        "lane": mission.lane_width_m if mission else CONVENTIONAL_LANE_M,
        "failures": [
            {
                "episode": f"{campaign}/{index}",
                "collides": outcome is Outcome.COLLISION,
                **failure.list_values(),
            }
            for failure, outcome, (campaign, index) in zip(
                failures, recordings.outcomes, recordings.episodes, strict=True
            )
        ],
    }
    road = recordings.scenes[0].road
    if not isinstance(road, msgspec.UnsetType):
        data["road"] = [round_rows(border) for border in road]
    return Chart(
        id=name,
        kind="overlay",
        title="Failures over each other",
        caption=f"From above. {first[0].upper()}{first[1:]} is opaque, the other failures are"
        " translucent.",
        data=data,
        table=list_rows(
            (
                "Time before the end [s]",
                "Failures under way",
                "Ego speed, median [m/s]",
                "Smallest [m/s]",
                "Largest [m/s]",
                "Distance, median [m]",
                "Smallest [m]",
                "Largest [m]",
            ),
            _iterate_rows(failures, recordings.scenes[0].dt_s),
            "Speed of the ego and distance to the nearest vehicle, by time before the end.",
        ),
    )


class _Failure:
    """Course of one failure: poses, speed of the ego, distance to the nearest vehicle."""

    def __init__(self, scene: Scene) -> None:
        self.last = len(scene.vehicles) - 1
        self.speed_mps = scene.vehicles[:, 0, 3].astype(np.float64)
        # An ego alone is apart from nothing.
        has_others = len(scene.sizes) > 1
        apart_m = measure_clearances(scene) if has_others else np.empty((self.last + 1, 0))
        self.apart_m = apart_m.min(axis=1, initial=inf)
        self.struck = find_struck(scene) if has_others else 0
        self._scene = scene

    def list_values(self) -> dict[str, object]:
        """Return the values for the player; a track is x, y, heading, x, y, heading, and so on."""
        poses = self._scene.vehicles[..., :3].astype(np.float64)
        # Rounded, or each of the many numbers would be written with all digits of a float.
        poses[..., :2] = poses[..., :2].round(CENTIMETRE)
        poses[..., 2] = poses[..., 2].round(MILLIRADIAN)
        return {
            "last": self.last,
            "struck": self.struck,
            "sizes": round_rows(self._scene.sizes),
            "tracks": [_list_known(track.ravel()) for track in poses.swapaxes(0, 1)],
            "speed": _list_known(self.speed_mps.round(1)),
            "apart": _list_known(self.apart_m.round(CENTIMETRE)),
        }


def _list_known(values: NDArray[np.float64]) -> list[float | None]:
    """Return numbers for JSON; None while a vehicle is not there."""
    return [
        value if is_known else None
        for value, is_known in zip(values.tolist(), np.isfinite(values).tolist(), strict=True)
    ]


def _iterate_rows(failures: Sequence[_Failure], dt_s: float) -> Iterator[tuple[str, ...]]:
    last = max(failure.last for failure in failures)
    # Counted from the end, where failures are aligned, so that rows of all lengths match.
    every = max(1, round(TABLE_STEP_S / dt_s), ceil(last / MOST_TABLE_ROWS))
    for before in range(last // every * every, -1, -every):
        under_way = [failure for failure in failures if failure.last >= before]
        speeds = [failure.speed_mps[failure.last - before] for failure in under_way]
        distances = [failure.apart_m[failure.last - before] for failure in under_way]
        yield (
            format_number(before * dt_s),
            str(len(under_way)),
            *_summarise(speeds),
            *_summarise([each for each in distances if each < inf]),
        )


def _summarise(values: Sequence[float]) -> tuple[str, str, str]:
    """Return median, smallest and largest value as text."""
    if not values:
        return (UNKNOWN,) * 3
    found = float(np.median(values)), min(values), max(values)
    median, smallest, largest = (format_number(each) for each in found)
    return median, smallest, largest


router = APIRouter(include_in_schema=False, default_response_class=HTMLResponse)

OVERLAYS = Depends(ConcurrencyLimit("overlays"), scope="function")


@router.get("/analyses/{analysis}/modes/{mode}/overlay", dependencies=[OVERLAYS])
def show_overlay(store: Stored, analysis: AnalysisId, mode: ModeNumber) -> HTMLResponse:
    """Show the failures of a mode over each other, which the page loads when a user opens it."""
    found, seen = store.analyses.mode(analysis, mode), store.analyses.get(analysis)
    noun, recordings, problem = read_result(seen).cluster_noun, None, ""
    try:
        recordings = load_mode_recordings(store, seen, mode, BOUNDS)
    except Conflict as error:
        problem = f"{error.problem} {error.remedy}".strip()
    return page(
        "overlay.html",
        recordings,
        mode=found,
        noun=noun,
        problem=problem,
        first=describe_first(recordings) if recordings else "",
        scene=make_overlay_chart(recordings, f"overlay-{analysis}-{mode}") if recordings else None,
    )
