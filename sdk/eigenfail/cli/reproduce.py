"""`eigenfail reproduce`: the paper's experiments on this world, beside the paper's numbers."""

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from eigenfail.cli.options import DEFAULT_DATA, AsJson, Data, Workers
from eigenfail.cli.output import show
from eigenfail.cli.places import MaybeUrl, client_of_suite
from eigenfail.cli.report import Force
from eigenfail.cli.reproduction_tables import page
from eigenfail.cli.surroundings import this_command
from eigenfail.cli.together import run_together
from eigenfail.client import Client
from eigenfail.client.reports import check_folder
from eigenfail.hosting.service import Plan
from eigenfail.reproduction.evidence import reproduction
from eigenfail.reproduction.files import files
from eigenfail.reproduction.programme import programme
from eigenfail.suites import Suite

app = typer.Typer(add_completion=False)


class Scale(StrEnum):
    """How many episodes."""

    SMALL = "small"
    FULL = "full"


REPORTED = (
    *("monte_carlo rulebook", "monte_carlo idm", "ast", "ast evaluation", "ast_paper evaluation"),
    *("ast plus5", "ast minus5", "difs", "difs evaluation", "difs_paper evaluation"),
)
"""Members that the report tells of; the paper's tables tell of all."""

HowMuch = Annotated[
    Scale, typer.Option(help="full: the paper's episodes; small: a fifth, for a first look.")
]
Seed = Annotated[
    int | None, typer.Option(min=0, help="Of all campaigns; each scale has one of its own.")
]
Output = Annotated[
    Path | None,
    typer.Option("--output", "-o", help="Folder for the report, the paper's tables and the data."),
]


@app.command()
def reproduce(
    context: typer.Context,
    scale: HowMuch = Scale.SMALL,
    output: Output = None,
    force: Force = False,
    seed: Seed = None,
    url: MaybeUrl = None,
    data: Data = DEFAULT_DATA,
    workers: Workers = 0,
    as_json: AsJson = False,
) -> None:
    """Run the paper's experiments, and print its tables with our numbers beside them.

    What the service has done of them before is found and not done again. Ctrl-C pauses them; the
    same command goes on.
    """
    suite = programme(scale, seed)
    if output is not None:
        check_folder(output, force)
    with client_of_suite(context, suite, url, Plan(data, 0, workers)) as (client, place):
        run_together(client, suite, place.check, this_command())
        found = reproduction(client, suite, scale)
        if output is not None:
            client.report(reported(client, suite), output, force, files(found))
    show(found, as_json, lambda: page(found))


def reported(client: Client, suite: Suite) -> list[int]:
    """The ids of the members that the report tells of."""
    found = zip(suite.members, client.suites.find(suite), strict=True)
    ids = {member.name: campaign.id for member, campaign in found if campaign is not None}
    return [ids[name] for name in REPORTED if name in ids]
