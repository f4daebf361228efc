"""`eigenfail worker list`: who works for a service."""

from collections.abc import Iterable, Sequence
from itertools import groupby
from typing import Annotated

import msgspec
import typer
from rich.console import Group, RenderableType
from rich.markup import escape
from rich.text import Text

from eigenfail.cli.moments import moment
from eigenfail.cli.options import DEFAULT_URL, AsJson, Url, Watched
from eigenfail.cli.surroundings import client_at
from eigenfail.cli.tables import table
from eigenfail.cli.watching import View
from eigenfail.client import Client
from eigenfail.hosting.signals import interruptible
from eigenfail.values import Campaign, CampaignState
from eigenfail.values.worker import WorkerShare

ACTIVE_S = 60
"""Who brought a result within so many seconds is at work."""

DAY_S = 86_400
COUNTS = ("campaigns", "episodes", "failures", "not runnable")
NOBODY = "Nobody brought a result in the last {} s. eigenfail doctor says what is missing."

Within = Annotated[
    int,
    typer.Option(
        "--within-s", min=ACTIVE_S, max=DAY_S, help="Whose results came in so many seconds. [s]"
    ),
]


class WorkerStanding(msgspec.Struct, frozen=True, kw_only=True):
    """What a worker did lately; only results that came within the time asked for count.

    Attributes:
        worker: its name; that of a worker without one is its host and process.
        at_work: whether it brought a result in the last minute.
        campaigns: whose episodes it ran.
        last_ms: when its last result was stored; milliseconds since 1970.
    """

    worker: str
    at_work: bool
    campaigns: tuple[int, ...]
    episodes: int
    failures: int
    failed: int
    last_ms: int


Seen = tuple[tuple[WorkerStanding, ...], tuple[Campaign, ...]]
"""Workers, and the campaigns that are running."""


def list_workers(
    context: typer.Context,
    within_s: Within = 600,
    url: Url = DEFAULT_URL,
    watched: Watched = False,
    as_json: AsJson = False,
) -> None:
    """List who brought results lately, and of which campaigns; the latest first.

    A worker that waits for work, or is in its first episodes, is not listed yet.
    """
    with interruptible(), client_at(context, url) as client:
        page: View[Seen] = View(
            look=lambda: (workers_of(client, within_s), running(client)),
            campaigns=lambda seen: seen[1],
            told=lambda seen: seen[0],
            draw=lambda seen: drawn(seen[0], within_s),
        )
        page.watch(as_json) if watched else page.show(as_json)


def running(client: Client) -> tuple[Campaign, ...]:
    """The campaigns that there is work for."""
    return tuple(client.campaigns.list(CampaignState.RUNNING))


def workers_of(client: Client, within_s: int) -> tuple[WorkerStanding, ...]:
    """Who worked within some seconds, who came last first."""
    at_work = {share.worker for share in client.workers(ACTIVE_S)}
    shares = sorted(client.workers(within_s), key=by_name)
    found = [standing([*group], at_work) for _, group in groupby(shares, by_name)]
    return tuple(sorted(found, key=lambda each: each.last_ms, reverse=True))


def by_name(share: WorkerShare) -> str:
    """Of whom it tells."""
    return share.worker


def standing(shares: Sequence[WorkerShare], at_work: Iterable[str]) -> WorkerStanding:
    """What one worker did, of all campaigns together."""
    return WorkerStanding(
        worker=shares[0].worker,
        at_work=shares[0].worker in at_work,
        campaigns=tuple(sorted(share.campaign for share in shares)),
        episodes=sum(share.episodes for share in shares),
        failures=sum(share.failures for share in shares),
        failed=sum(share.failed for share in shares),
        last_ms=max(share.last_ms for share in shares),
    )


def drawn(workers: Sequence[WorkerStanding], within_s: int) -> RenderableType:
    """One row for each worker, or that there is none."""
    grid = table("worker", "state", *COUNTS, "last result", right=COUNTS)
    for each in workers:
        cells = (each.worker, "at work" if each.at_work else "quiet")
        counts = (len(each.campaigns), each.episodes, each.failures, each.failed)
        grid.add_row(*map(escape, cells), *map(str, counts), moment(each.last_ms))
    return grid if workers else Group(Text(NOBODY.format(within_s)))
