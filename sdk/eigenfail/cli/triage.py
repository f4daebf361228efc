"""`eigenfail mode triage`: the triage of a failure mode, shown and changed."""

from typing import Annotated

import typer
from rich.console import RenderableType

from eigenfail.cli.render import Answer
from eigenfail.cli.service_command import asks_service
from eigenfail.client import Client
from eigenfail.client.triage import TriageFields
from eigenfail.presentation.figures import format_local_time
from eigenfail.presentation.tables import FactTable
from eigenfail.presentation.terminal import render
from eigenfail.values.triage import Triage, TriageState

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


@asks_service()
def triage_mode(
    client: Client,
    analysis: AnalysisId,
    number: ModeNumber,
    state: NewState = None,
    ticket: NewTicket = None,
    note: NewNote = None,
) -> Answer:
    """Show the triage of a failure mode; change its state, ticket or note if one is given."""
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
    return Answer(found, lambda: _draw_triage(found))


def _draw_triage(found: Triage) -> RenderableType:
    changed = "" if found.changed_ms is None else format_local_time(found.changed_ms)
    facts = (
        ("state", found.state.words),
        ("ticket", found.ticket or "none"),
        ("note", found.note or "none"),
        ("changed", f"{changed}, by {found.changed_by}" if changed else "never"),
    )
    return render(FactTable("Triage", facts))
