"""`eigenfail release`: the versions of a planner, and what became of each failure mode."""

import typer

from eigenfail.cli.answers import prints_answer
from eigenfail.cli.options import CampaignId, Project
from eigenfail.cli.render import CommandResult
from eigenfail.client import Client
from eigenfail.presentation.releases import tabulate_questions, tabulate_releases

app = typer.Typer(add_completion=False, no_args_is_help=True)


@app.callback()
def release() -> None:
    """Compare the versions of a planner, failure mode by failure mode."""


@app.command("list")
@prints_answer("Reading the versions")
def list_releases(client: Client, project: Project = None) -> CommandResult:
    """List the scenarios in which versions of a planner were tested.

    Only campaigns that name the version of their planner count.
    """
    found = client.releases.list(project)
    return CommandResult(found, tabulate_questions(found))


@app.command("show")
@prints_answer("Comparing the versions")
def show_release(client: Client, campaign: CampaignId) -> CommandResult:
    """Show the versions tested as in a campaign: which failure modes came, went and came back.

    The campaigns must be analysed (`eigenfail analyze`).
    """
    found = client.releases.get(campaign)
    return CommandResult(found, *tabulate_releases(found))
