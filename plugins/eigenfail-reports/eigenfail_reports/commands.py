"""Write a report on campaigns: one self-contained HTML file, and its data."""

from pathlib import Path
from typing import Annotated

import typer

from eigenfail.cli.connection import connect_to
from eigenfail.cli.options import AsJson, Url
from eigenfail.cli.render import show
from eigenfail.hosting.folder import DEFAULT_URL
from eigenfail.progress import announce
from eigenfail_reports.client import write_report

app = typer.Typer(add_completion=False)

CampaignIds = Annotated[
    list[int], typer.Argument(metavar="CAMPAIGN...", min=1, help="Ids of campaigns.")
]
Output = Annotated[
    Path,
    typer.Option(
        "--output",
        "-o",
        metavar="FOLDER",
        help="Folder of the report; created if it does not exist.",
    ),
]
Force = Annotated[bool, typer.Option("--force", help="Replace the report that is in the folder.")]


@app.command()
def report(  # noqa: PLR0913, PLR0917 - typer makes an option of each argument
    context: typer.Context,
    campaigns: CampaignIds,
    output: Output = Path("report"),
    force: Force = False,
    url: Url = DEFAULT_URL,
    as_json: AsJson = False,
) -> None:
    """Write a report on campaigns: one self-contained HTML file, and its data.

    The folder holds report.html, report.json, tables/*.csv and pictures/*.svg.
    """
    with connect_to(context, url) as client, announce("Writing the report"):
        made = write_report(client, campaigns, output, force=force)
    show(made, as_json, f"The report is in {output / 'report.html'}.")
