"""`eigenfail worker list`: who works for a service."""

from collections import defaultdict
from collections.abc import Sequence
from enum import StrEnum
from typing import Annotated

import msgspec
import typer
from rich.console import Group, RenderableType
from rich.markup import escape
from rich.text import Text

from eigenfail.cli.figures import UNKNOWN
from eigenfail.cli.moments import moment
from eigenfail.cli.options import DEFAULT_URL, AsJson, Url, Watched
from eigenfail.cli.surroundings import client_at
from eigenfail.cli.tables import table
from eigenfail.cli.watching import View
from eigenfail.client import Client
from eigenfail.hosting.signals import interruptible
from eigenfail.values import Campaign, CampaignState
from eigenfail.values.worker import ACTIVE_S, DAY_S, Presence, WorkerShare

PACKAGE = "eigenfail"
COUNTS = ("campaigns", "episodes", "failures", "not runnable")
NOBODY = (
    "No worker is connected, and none brought a result in the last {} s. "
    "eigenfail doctor says what is missing."
)

Within = Annotated[
    int,
    typer.Option(
        "--within-s", min=ACTIVE_S, max=DAY_S, help="Whose results came in so many seconds. [s]"
    ),
]


class WorkerState(StrEnum):
    """What a worker is at."""

    AT_WORK = "at work"
    WAITING = "waiting"
    GONE = "gone"


class WorkerStanding(msgspec.Struct, frozen=True, kw_only=True):
    """What a worker did lately; only results that came within the time asked for count.

    Attributes:
        worker: its name; that of a worker without one is its host and process.
        host: the machine that it runs on; empty if it is not connected now.
        version: of its eigenfail; empty likewise.
        state: gone if it is not connected; at work if it brought a result in the last minute.
        campaigns: whose episodes it ran.
        since_ms: when it connected; milliseconds since 1970, null if it is not connected now.
        last_ms: when its last result was stored; null before the first one.
    """

    worker: str
    host: str
    version: str
    state: WorkerState
    campaigns: tuple[int, ...]
    episodes: int
    failures: int
    failed: int
    since_ms: int | None
    last_ms: int | None


Seen = tuple[tuple[WorkerStanding, ...], tuple[Campaign, ...]]
"""Workers, and the campaigns that are running."""


def list_workers(
    context: typer.Context,
    within_s: Within = 600,
    url: Url = DEFAULT_URL,
    watched: Watched = False,
    as_json: AsJson = False,
) -> None:
    """List who is connected, and who brought results lately; the latest results first."""
    with interruptible(), client_at(context, url) as client:
        page: View[Seen] = View(
            look=lambda: look(client, within_s),
            campaigns=lambda seen: seen[1],
            told=lambda seen: seen[0],
            draw=lambda seen: drawn(seen[0], within_s),
        )
        page.watch(as_json) if watched else page.show(as_json)


def look(client: Client, within_s: int) -> Seen:
    """What there is now; once nothing runs any more, the workers' counts are the last ones."""
    campaigns = running(client)
    return workers_of(client, within_s), campaigns


def running(client: Client) -> tuple[Campaign, ...]:
    """The campaigns that there is work for."""
    return tuple(client.campaigns.list(CampaignState.RUNNING))


def workers_of(client: Client, within_s: int) -> tuple[WorkerStanding, ...]:
    """Who is connected, and who worked within some seconds; who came last first."""
    at_work = {share.worker for share in client.workers(ACTIVE_S)}
    here = {presence.worker: presence for presence in client.present_workers()}
    shares = defaultdict[str, list[WorkerShare]](list, {name: [] for name in here})
    for share in client.workers(within_s):
        shares[share.worker].append(share)
    found = [
        standing(name, theirs, here.get(name), is_at_work=name in at_work)
        for name, theirs in shares.items()
    ]
    return tuple(sorted(found, key=lambda each: (-(each.last_ms or 0), each.worker)))


def standing(
    name: str, shares: Sequence[WorkerShare], here: Presence | None, *, is_at_work: bool
) -> WorkerStanding:
    """What one worker did, of all campaigns together."""
    present = WorkerState.AT_WORK if is_at_work else WorkerState.WAITING
    return WorkerStanding(
        worker=name,
        host=here.host if here else "",
        version=here.versions.get(PACKAGE, "") if here else "",
        state=present if here else WorkerState.GONE,
        campaigns=tuple(sorted(share.campaign for share in shares)),
        episodes=sum(share.episodes for share in shares),
        failures=sum(share.failures for share in shares),
        failed=sum(share.failed for share in shares),
        since_ms=here.arrived_ms if here else None,
        last_ms=max((share.last_ms for share in shares), default=None),
    )


def drawn(workers: Sequence[WorkerStanding], within_s: int) -> RenderableType:
    """One row for each worker, or that there is none."""
    grid = table("worker", "host", PACKAGE, "state", *COUNTS, "last result", right=COUNTS)
    for each in workers:
        cells = (each.worker, each.host or UNKNOWN, each.version or UNKNOWN, each.state)
        counts = (len(each.campaigns), each.episodes, each.failures, each.failed)
        last = UNKNOWN if each.last_ms is None else moment(each.last_ms)
        grid.add_row(*map(escape, cells), *map(str, counts), last)
    return grid if workers else Group(Text(NOBODY.format(within_s)))
