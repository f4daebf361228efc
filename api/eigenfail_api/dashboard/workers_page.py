"""The page of the workers: who is connected, what each runs, and how fast."""

from collections import Counter

from fastapi import APIRouter
from fastapi.responses import HTMLResponse

from eigenfail.presentation.workers import WorkerState, combine_activity
from eigenfail.values.operations import ACTIVE_S
from eigenfail_api.dashboard.rendering import Badge, Tile, page
from eigenfail_api.parameters import Stored
from eigenfail_services.campaigns import summary

WINDOW = f"results of the last {ACTIVE_S} s"

STATE_BADGES = {
    WorkerState.AT_WORK: Badge("at work", "▶", "active"),
    WorkerState.WAITING: Badge("waiting", "○", "waiting"),
    WorkerState.GONE: Badge("gone", "×", "ended"),
}


router = APIRouter(include_in_schema=False, default_response_class=HTMLResponse)


@router.get("/workers")
def show_workers(store: Stored) -> HTMLResponse:
    """Serve the list of workers that are connected, or had results in the last ten minutes."""
    here, lately = summary.count_present(store), summary.list_recent_workers(store, ACTIVE_S)
    results = Counter[str]()
    for share in lately:
        results[share.worker] += share.episodes
    found = combine_activity(here, summary.list_recent_workers(store), lately)
    # Those that are gone last; the order is otherwise by the latest result.
    workers = sorted(found, key=lambda each: each.state is WorkerState.GONE)
    states = Counter(each.state for each in workers)
    return page(
        "workers.html",
        workers,
        staffing=summary.make_staffing(store, len(here), summary.list_unrunnable(store)),
        figures=(
            ("Connected", Tile(len(workers) - states[WorkerState.GONE])),
            ("At work", Tile(states[WorkerState.AT_WORK])),
            ("Waiting", Tile(states[WorkerState.WAITING])),
            ("Episodes/s now", Tile(results.total() / ACTIVE_S, (WINDOW,))),
        ),
        badges=STATE_BADGES,
        rates={worker: count / ACTIVE_S for worker, count in results.items()},
        within=f"{summary.LATELY_S // 60} min",
    )
