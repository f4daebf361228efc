"""`eigenfail mode`: list the failure modes of an analysis, name them, and track them."""

from collections.abc import Iterable
from typing import Annotated

import typer
from rich.markup import escape
from rich.table import Table

from eigenfail.cli.connection import connect_to
from eigenfail.cli.options import AsJson, Url
from eigenfail.cli.render import make_console, show, to_json
from eigenfail.cli.triage import AnalysisId, ModeNumber, triage_mode
from eigenfail.hosting.folder import DEFAULT_URL
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
def list_modes(
    context: typer.Context,
    analysis: AnalysisId,
    url: Url = DEFAULT_URL,
    state: OnlyState = None,
    as_json: AsJson = False,
) -> None:
    """List the failure modes of an analysis, with their names, failures and triage.

    A mode that was given no name has the beginning of its description for one.
    """
    with connect_to(context, url) as client:
        found = client.analyses.modes(analysis, state)
    show(found, as_json, lambda: _draw_modes(found))


@app.command("rename")
def rename_mode(
    context: typer.Context,
    analysis: AnalysisId,
    number: ModeNumber,
    name: ModeName,
    url: Url = DEFAULT_URL,
    as_json: AsJson = False,
) -> None:
    """Give a failure mode a name, which its page, its episodes' pages and `mode list` show."""
    with connect_to(context, url) as client:
        renamed = client.analyses.rename_mode(analysis, number, name)
    if as_json:
        typer.echo(to_json(renamed))
        return
    make_console().print(f"Mode {renamed.number} of analysis {analysis}: {escape(renamed.name)}")


def _draw_modes(modes: Iterable[Mode]) -> Table:
    """A row for each mode."""
    grid = start_grid("mode", "name", "failures", "state", right=("mode", "failures"))
    for each in modes:
        grid.add_row(
            str(each.number), escape(each.name), f"{each.failures:,}", escape(each.state.words)
        )
    return grid


app.command("triage")(triage_mode)
