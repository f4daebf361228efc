"""Show where among the scenario's parameters the episodes of campaigns fail."""

from typing import Annotated

import typer

from eigenfail.cli.answers import prints_answer
from eigenfail.cli.render import CommandResult
from eigenfail.client import Client
from eigenfail_failing_region.client import ask_region
from eigenfail_failing_region.presentation import describe_region

app = typer.Typer(add_completion=False)

CampaignIds = Annotated[
    list[int],
    typer.Argument(
        metavar="CAMPAIGN...", min=1, help="A campaign with varying parameters, or those of a grid."
    ),
]


@app.command()
@prints_answer("Searching for the failing region")
def region(client: Client, campaigns: CampaignIds) -> CommandResult:
    """Show where among the scenario's parameters the episodes of campaigns fail."""
    found = ask_region(client, campaigns)
    return CommandResult(found, *describe_region(found))
