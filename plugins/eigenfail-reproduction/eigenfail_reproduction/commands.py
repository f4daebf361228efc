"""Run the paper's experiments, and print our numbers next to the paper's."""

from collections.abc import Iterator
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from eigenfail.cli.connection import MaybeUrl, connect_for_suite, this_command
from eigenfail.cli.options import AsJson, Data, Workers
from eigenfail.cli.render import run_suite, show
from eigenfail.client import Client
from eigenfail.files import check_output_folder, write_folder
from eigenfail.hosting.folder import DEFAULT_DATA
from eigenfail.hosting.service import Plan
from eigenfail.presentation.tables import Block, Table, count_columns, name_columns
from eigenfail.progress import announce
from eigenfail.suites import Suite
from eigenfail_reproduction import page
from eigenfail_reproduction.paper import PaperReproduction, PaperTable
from eigenfail_reproduction.programme import PROGRAMMES, build_suite
from eigenfail_reproduction.report import FILE, fetch_report
from eigenfail_reproduction.statements import build_reproduction


def describe_reproduction(found: PaperReproduction) -> Iterator[Block]:
    """Yield every table, then what the paper says of them."""
    for each in found.tables:
        yield f"\n{each.title}"
        yield _tabulate(each)
    yield "\nWhat the paper says"
    for statement in found.statements:
        yield (
            f"{page.format_verdict(statement)}: {statement.paper}\n  Holds if: {statement.rule}\n"
            f"  {statement.figures}"
        )


def _tabulate(of: PaperTable) -> Table:
    """Our numbers, and the paper's in brackets behind them."""
    rows = []
    for row in of.rows:
        numbers = zip(of.columns, row.numbers, strict=True)
        cells = (
            f"{page.format_our_number(c, n)}{page.format_paper_number(c, n)}" for c, n in numbers
        )
        rows.append((row.name, *cells))
    columns = (*name_columns(""), *count_columns(*map(page.format_heading, of.columns)))
    return Table(of.title, columns, tuple(rows), (of.note,) if of.note else ())


app = typer.Typer(add_completion=False)


class Scale(StrEnum):
    """How many episodes."""

    SMALL = "small"
    FULL = "full"
    LEARNERS = "learners"


REPORTED = (
    "monte_carlo rulebook",
    "monte_carlo idm",
    "held",
    "ast",
    "ast evaluation",
    "ast_paper evaluation",
    "ast plus5",
    "ast minus5",
    "difs",
    "difs evaluation",
    "difs_paper evaluation",
    "ast farther",
    "ast nearer",
)
"""Members that the report covers; the paper's tables cover all."""

HowMuch = Annotated[
    Scale,
    typer.Option(
        help="full: the paper's episodes; small: under a third, for a first look; learners: "
        "of small the training and evaluation alone."
    ),
]
ScenarioName = Annotated[str, typer.Option(help=f"Scenario: {' or '.join(PROGRAMMES)}.")]
Seed = Annotated[
    int | None, typer.Option(min=0, help="Seed of all campaigns (default: that of the scale).")
]
Output = Annotated[
    Path | None,
    typer.Option(
        "--output",
        "-o",
        metavar="FOLDER",
        help="Folder for the report, the paper's tables and the data.",
    ),
]
Force = Annotated[bool, typer.Option("--force", help="Replace the report that is in the folder.")]


@app.command()
def reproduce(  # noqa: PLR0913, PLR0917 - typer makes an option of each argument
    context: typer.Context,
    scale: HowMuch = Scale.SMALL,
    scenario: ScenarioName = "cut_in",
    output: Output = None,
    force: Force = False,
    seed: Seed = None,
    url: MaybeUrl = None,
    data: Data = DEFAULT_DATA,
    workers: Workers = 0,
    as_json: AsJson = False,
) -> None:
    """Run the paper's experiments, and print our numbers next to the paper's.

    Campaigns that the service has run before are not run again. Ctrl-C pauses them; the same
    command resumes them.
    """
    suite = build_suite(scale, seed, scenario)
    if output is not None:
        check_output_folder(output, "report", FILE, force=force)
    with connect_for_suite(context, suite, url, Plan(data, 0, workers)) as (client, place):
        run_suite(client, suite, place.check, this_command())
        with announce("Reading the results of the campaigns") as begin:
            found = build_reproduction(client, suite, scale, scenario, begin)
            if output is not None:
                begin("Writing the report")
                files = fetch_report(client, _list_reported_campaigns(client, suite))
                write_folder(files | page.list_files(found), output)
    show(found, as_json, *describe_reproduction(found))


def _list_reported_campaigns(client: Client, suite: Suite) -> list[int]:
    """Return the ids of the members that the report includes."""
    found = zip(suite.members, client.suites.find(suite), strict=True)
    ids = {member.name: campaign.id for member, campaign in found if campaign is not None}
    return [ids[name] for name in REPORTED if name in ids]
