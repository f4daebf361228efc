"""`eigenfail campaign workers`: who ran the episodes of a campaign."""

from collections.abc import Sequence

import typer
from rich.markup import escape
from rich.table import Table

from eigenfail.cli.figures import number
from eigenfail.cli.moments import moment
from eigenfail.cli.options import DEFAULT_URL, AsJson, CampaignId, Url
from eigenfail.cli.output import show
from eigenfail.cli.surroundings import client_at
from eigenfail.cli.tables import table
from eigenfail.values.worker import WorkerShare

FIGURES = ("episodes", "failures", "not runnable", "s/episode")


def workers(
    context: typer.Context,
    campaign: CampaignId,
    url: Url = DEFAULT_URL,
    as_json: AsJson = False,
) -> None:
    """Show who ran the episodes of a campaign: how many, how quickly, and when last."""
    with client_at(context, url) as client:
        found = client.campaigns.workers(campaign)
    show(found, as_json, lambda: worker_table(found))


def worker_table(shares: Sequence[WorkerShare]) -> Table:
    """One row for each worker; who ran most comes first."""
    grid = table("worker", *FIGURES, "last result", right=FIGURES)
    for share in shares:
        counts = map(str, (share.episodes, share.failures, share.failed))
        mean_s = number(share.wall_s / share.episodes, 3)
        grid.add_row(escape(share.worker), *counts, mean_s, moment(share.last_ms))
    return grid
