"""Who runs the episodes."""

from collections.abc import Sequence

from eigenfail.values.worker import Presence, WorkerShare
from eigenfail_api.dashboard import formats
from eigenfail_api.dashboard.views.findings import Grid
from eigenfail_api.dashboard.views.summaries import Figure

MOST_LINES = 100


COLUMNS = (
    "Worker",
    "Episodes",
    "Share",
    "Failures",
    "Not runnable",
    "Mean time of an episode",
    "Last result",
)


def crew_view(shares: Sequence[WorkerShare]) -> Grid:
    """Who ran a campaign's episodes; no row before the first result."""
    of = sum(share.episodes for share in shares)
    left = len(shares) - MOST_LINES
    return Grid(
        "Workers",
        COLUMNS,
        tuple(worker_line(share, of) for share in shares[:MOST_LINES]),
        f"In the API, with fewer episodes: {formats.counted(left, 'worker')}." if left > 0 else "",
    )


def worker_line(share: WorkerShare, of: int) -> tuple[str, ...]:
    """One worker, beside all episodes that have a result."""
    return (
        share.worker,
        formats.integer(share.episodes),
        f"{100.0 * share.episodes / of:.1f} %",
        formats.integer(share.failures),
        formats.integer(share.failed),
        formats.duration(share.wall_s / share.episodes),
        formats.moment(share.last_ms),
    )


def crew_tiles(
    here: Sequence[Presence], lately: Sequence[WorkerShare], within_s: int
) -> tuple[tuple[str, Figure], ...]:
    """How many are there now, and how quickly they work: by the results of the last seconds."""
    at_work = {share.worker for share in lately}
    names = {presence.worker for presence in here} | at_work
    episodes = sum(share.episodes for share in lately)
    window = f"results of the last {within_s} s"
    return (
        ("Workers now", Figure(formats.integer(len(names)), (f"{len(at_work)} with {window}",))),
        ("Episodes/s now", Figure(formats.number(episodes / within_s), (window,))),
    )
