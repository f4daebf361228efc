"""`eigenfail mode`: list the failure modes of an analysis, name them, and track them."""

from collections.abc import Iterable
from typing import Annotated

import typer
from rich.markup import escape
from rich.table import Table

from eigenfail.cli.render import Answer
from eigenfail.cli.service_command import asks_service
from eigenfail.cli.triage import AnalysisId, ModeNumber, triage_mode
from eigenfail.client import Client
from eigenfail.presentation.terminal import start_grid
from eigenfail.values import Mode
from eigenfail.values.triage import TriageState

app = typer.Typer(add_completion=False, no_args_is_help=True)

ModeName = Annotated[
    str, typer.Argument(metavar="NAME", help="Its name, of at most 80 characters.")
]


OnlyState = Annotated[
    TriageState | None, typer.Option("--state", help="Only modes in this state of triage.")
]


@app.callback()
def mode() -> None:
    """List the failure modes of an analysis, name them, and track them to their end."""


@app.command("list")
@asks_service()
def list_modes(client: Client, analysis: AnalysisId, state: OnlyState = None) -> Answer:
    """List the failure modes of an analysis, with their names, failures and triage.

    A mode that was given no name has the beginning of its description for one.
    """
    found = client.analyses.modes(analysis, state)
    return Answer(found, lambda: _draw_modes(found))


@app.command("rename")
@asks_service()
def rename_mode(client: Client, analysis: AnalysisId, number: ModeNumber, name: ModeName) -> Answer:
    """Give a failure mode a name, which its page, its episodes' pages and `mode list` show."""
    renamed = client.analyses.rename_mode(analysis, number, name)
    words = f"Mode {renamed.number} of analysis {analysis}: {escape(renamed.name)}"
    return Answer(renamed, lambda: words)


def _draw_modes(modes: Iterable[Mode]) -> Table:
    """A row for each mode."""
    grid = start_grid("mode", "name", "failures", "state", right=("mode", "failures"))
    for each in modes:
        grid.add_row(
            str(each.number), escape(each.name), f"{each.failures:,}", escape(each.state.words)
        )
    return grid


app.command("triage")(triage_mode)
