"""`eigenfail mode`: list the failure modes of an analysis, name them, and track them."""

from collections.abc import Iterable
from typing import Annotated

import typer

from eigenfail.cli.answers import prints_answer
from eigenfail.cli.render import CommandResult
from eigenfail.client import Client
from eigenfail.client.analyses import TriageFields
from eigenfail.presentation import tables
from eigenfail.presentation.figures import format_local_time
from eigenfail.values.analysis import Mode
from eigenfail.values.triage import Triage, TriageState

app = typer.Typer(add_completion=False, no_args_is_help=True)

AnalysisId = Annotated[int, typer.Argument(metavar="ANALYSIS", min=1, help="Id of an analysis.")]
ModeNumber = Annotated[
    int, typer.Argument(metavar="NUMBER", min=1, help="Number of the mode, from 1.")
]
NewState = Annotated[TriageState | None, typer.Option("--state", help="The new state.")]
NewTicket = Annotated[
    str | None,
    typer.Option("--ticket", metavar="URL", help='Address of its ticket; "" for none.'),
]
NewNote = Annotated[
    str | None,
    typer.Option(
        "--note", metavar="TEXT", help='The note, in place of the one before; "" for none.'
    ),
]

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
@prints_answer()
def list_modes(client: Client, analysis: AnalysisId, state: OnlyState = None) -> CommandResult:
    """List the failure modes of an analysis, with their names, failures and triage.

    A mode that was given no name has the beginning of its description for one.
    """
    found = client.analyses.modes(analysis, state)
    return CommandResult(found, _tabulate_modes(found))


@app.command("rename")
@prints_answer()
def rename_mode(
    client: Client, analysis: AnalysisId, number: ModeNumber, name: ModeName
) -> CommandResult:
    """Give a failure mode a name, which its page, its episodes' pages and `mode list` show."""
    renamed = client.analyses.rename_mode(analysis, number, name)
    return CommandResult(renamed, f"Mode {renamed.number} of analysis {analysis}: {renamed.name}")


def _tabulate_modes(modes: Iterable[Mode]) -> tables.Table:
    """A row for each mode."""
    return tables.tabulate(
        "Modes",
        modes,
        tables.read_number("Mode", lambda mode: str(mode.number)),
        tables.read_text("Name", "name"),
        tables.read_number("Failures", "failures"),
        tables.read_text("State", "state.words"),
    )


@app.command("triage")
@prints_answer()
def triage_mode(
    client: Client,
    analysis: AnalysisId,
    number: ModeNumber,
    state: NewState = None,
    ticket: NewTicket = None,
    note: NewNote = None,
) -> CommandResult:
    """Show the triage of a failure mode; change its state, ticket or note if one is given."""
    # An empty text clears a ticket or note; an option that is not given changes nothing.
    fields = TriageFields()
    if state is not None:
        fields["state"] = state
    if ticket is not None:
        fields["ticket"] = ticket
    if note is not None:
        fields["note"] = note
    if fields:
        found = client.triage.change_mode(analysis, number, **fields)
    else:
        found = client.triage.get_mode(analysis, number)
    return CommandResult(found, _list_triage_facts(found))


def _list_triage_facts(found: Triage) -> tables.FactTable:
    changed = "" if found.changed_ms is None else format_local_time(found.changed_ms)
    facts = (
        ("state", found.state.words),
        ("ticket", found.ticket or "none"),
        ("note", found.note or "none"),
        ("changed", f"{changed}, by {found.changed_by}" if changed else "never"),
    )
    return tables.FactTable("Triage", facts)
