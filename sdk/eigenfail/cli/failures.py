"""`eigenfail episode failures`: the failures of all campaigns in one list."""

from typing import Annotated

import typer

from eigenfail.cli import completion
from eigenfail.cli.options import Limit
from eigenfail.cli.render import Answer, first_rows
from eigenfail.cli.service_command import asks_service
from eigenfail.client import Client
from eigenfail.presentation.episodes import tabulate_failures
from eigenfail.presentation.terminal import render
from eigenfail.values.failures import FAILURE_ORDERS, MOST_SEVERE_FIRST

Project = Annotated[str | None, typer.Option(help="Only failures of this project.")]
Planner = Annotated[
    str | None,
    typer.Option(
        help="Only failures of this planner.", autocompletion=completion.complete_planners
    ),
]
PlannerVersion = Annotated[
    str | None, typer.Option(help="Only failures of this version of a planner.")
]
Method = Annotated[
    str | None,
    typer.Option(
        help="Only failures that this method found.", autocompletion=completion.complete_methods
    ),
]
Sort = Annotated[str, typer.Option(help=f"{' or '.join(FAILURE_ORDERS)}.")]
Archived = Annotated[
    bool, typer.Option("--archived", help="List failures of archived campaigns, too.")
]


@asks_service()
def list_failures(
    client: Client,
    project: Project = None,
    planner: Planner = None,
    planner_version: PlannerVersion = None,
    method: Method = None,
    sort: Sort = MOST_SEVERE_FIRST,
    archived: Archived = False,
    limit: Limit = 20,
) -> Answer:
    """List the collisions of all campaigns, the most severe first.

    Campaigns that repeat earlier failures are left out unless --method names theirs.
    """
    found = client.episodes.list_failures(
        project=project,
        planner=planner,
        planner_version=planner_version,
        method=method,
        sort=sort,
        archived=archived,
    )
    return first_rows(found, limit, lambda rows: render(tabulate_failures(rows)))
