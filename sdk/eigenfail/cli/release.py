"""`eigenfail release`: the versions of a planner, and what became of each failure mode."""

from typing import Annotated

import typer

from eigenfail.cli.connection import connect_to
from eigenfail.cli.options import AsJson, CampaignId, Url
from eigenfail.cli.render import show
from eigenfail.hosting.folder import DEFAULT_URL
from eigenfail.presentation.releases import tabulate_questions, tabulate_releases
from eigenfail.presentation.terminal import render
from eigenfail.progress import announce

app = typer.Typer(add_completion=False, no_args_is_help=True)

Project = Annotated[str | None, typer.Option(help="Only campaigns of this project.")]


@app.callback()
def release() -> None:
    """Compare the versions of a planner, failure mode by failure mode."""


@app.command("list")
def list_releases(
    context: typer.Context,
    url: Url = DEFAULT_URL,
    project: Project = None,
    as_json: AsJson = False,
) -> None:
    """List the scenarios in which versions of a planner were tested.

    Only campaigns that name the version of their planner count.
    """
    with connect_to(context, url) as client, announce("Reading the versions"):
        found = client.releases.list(project)
    show(found, as_json, lambda: render(tabulate_questions(found)))


@app.command("show")
def show_release(
    context: typer.Context, campaign: CampaignId, url: Url = DEFAULT_URL, as_json: AsJson = False
) -> None:
    """Show the versions tested as in a campaign: which failure modes came, went and came back.

    The campaigns must be analysed (`eigenfail analyze`).
    """
    with connect_to(context, url) as client, announce("Comparing the versions"):
        found = client.releases.get(campaign)
    show(found, as_json, lambda: render(*tabulate_releases(found)))
