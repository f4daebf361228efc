"""The page of the workers: who is connected, what each runs, and how fast."""

from collections import Counter

import msgspec
from fastapi import APIRouter
from fastapi.responses import HTMLResponse

from eigenfail.presentation.figures import UNKNOWN, format_count, format_number
from eigenfail.presentation.workers import WorkerActivity, WorkerState, combine_activity
from eigenfail.values.operations import ACTIVE_S, Event
from eigenfail_api.dashboard.rendering import Badge, Tile, page, write_time
from eigenfail_api.parameters import Stored
from eigenfail_services.campaigns import summary
from eigenfail_services.store import Store

STATE_BADGES = {
    WorkerState.AT_WORK: Badge("at work", "▶", "active"),
    WorkerState.WAITING: Badge("waiting", "○", "waiting"),
    WorkerState.GONE: Badge("gone", "×", "ended"),
}


class WorkerLine(msgspec.Struct, frozen=True, kw_only=True):
    """A worker's row.

    Attributes:
        episodes: results of the last ten minutes, errored ones included.
        rate: results per second over the last minute.
        heard: when its hub last said that it is there.
    """

    worker: str
    host: str
    processor: str
    version: str
    state: Badge
    campaigns: tuple[int, ...]
    episodes: int
    errored: int
    rate: str
    last_result: str
    heard: str


class WorkersView(msgspec.Struct, frozen=True, kw_only=True):
    """The page.

    Attributes:
        within: the time whose results are counted, in words.
        said: what the services last said of workers to come; empty if nothing, and once there are
            workers.
        stranded: what was said of each running campaign that no connected worker can run.
    """

    tiles: tuple[tuple[str, Tile], ...]
    lines: tuple[WorkerLine, ...]
    within: str
    said: str
    stranded: tuple[Event, ...]


router = APIRouter(include_in_schema=False, default_response_class=HTMLResponse)


@router.get("/workers")
def show_workers(store: Stored) -> HTMLResponse:
    """Serve the list of workers that are connected, or had results in the last ten minutes."""
    return page("workers.html", make_workers_view(store))


def make_workers_view(store: Store) -> WorkersView:
    """Return the page as things stand."""
    here, lately = summary.count_present(store), summary.list_recent_workers(store, ACTIVE_S)
    staffing = summary.make_staffing(store, len(here), summary.list_unrunnable(store))
    results = Counter[str]()
    for share in lately:
        results[share.worker] += share.episodes
    found = combine_activity(here, summary.list_recent_workers(store), lately)
    workers = tuple(sorted(found, key=lambda each: each.state is WorkerState.GONE))
    return WorkersView(
        tiles=_make_tiles(workers, results.total()),
        lines=tuple(_make_line(each, results[each.worker]) for each in workers),
        within=f"{summary.LATELY_S // 60} min",
        said="" if staffing.workers else staffing.said,
        stranded=staffing.stranded,
    )


def _make_tiles(workers: tuple[WorkerActivity, ...], results: int) -> tuple[tuple[str, Tile], ...]:
    states = Counter(each.state for each in workers)
    connected = len(workers) - states[WorkerState.GONE]
    return (
        ("Connected", Tile(format_count(connected), ())),
        ("At work", Tile(format_count(states[WorkerState.AT_WORK]), ())),
        ("Waiting", Tile(format_count(states[WorkerState.WAITING]), ())),
        ("Episodes/s now", Tile(format_number(results / ACTIVE_S), (_WINDOW,))),
    )


_WINDOW = f"results of the last {ACTIVE_S} s"


def _make_line(each: WorkerActivity, results: int) -> WorkerLine:
    return WorkerLine(
        worker=each.worker,
        host=each.host or UNKNOWN,
        processor=each.processor or UNKNOWN,
        version=each.version or UNKNOWN,
        state=STATE_BADGES[each.state],
        campaigns=each.campaigns,
        episodes=each.episodes,
        errored=each.errored,
        rate=format_number(results / ACTIVE_S),
        last_result=write_time(each.last_ms),
        heard=write_time(each.heard_ms),
    )
