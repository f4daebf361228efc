"""Triage from the command line: the commands of `eigenfail mode` and `eigenfail episode` for it."""

from collections.abc import Sequence
from typing import Annotated

import typer
from rich.console import RenderableType
from rich.markup import escape

from eigenfail.cli.connection import connect_to
from eigenfail.cli.options import AsJson, EpisodeId, Limit, Url, parse_episode_id
from eigenfail.cli.render import make_console, show, to_json
from eigenfail.client.triage import TriageFields
from eigenfail.errors import InvalidValue
from eigenfail.hosting.folder import DEFAULT_URL
from eigenfail.presentation.figures import format_local_time
from eigenfail.presentation.tables import FactTable, Table, TableColumn
from eigenfail.presentation.terminal import render
from eigenfail.values.triage import Triage, TriageCount, TriageNote, TriageState

AnalysisId = Annotated[int, typer.Argument(metavar="ANALYSIS", min=1, help="Id of an analysis.")]
ModeNumber = Annotated[
    int, typer.Argument(metavar="NUMBER", min=1, help="Number of the mode, from 1.")
]
ModeNumbers = Annotated[
    list[int], typer.Argument(metavar="NUMBER...", min=1, help="Numbers of the modes, from 1.")
]
Triaged = Annotated[
    str,
    typer.Argument(
        metavar="CAMPAIGN[/INDEX]",
        help="One episode, such as 3/17, or a campaign, of which --filter selects episodes.",
    ),
]
NewState = Annotated[TriageState | None, typer.Option("--state", help="The new state.")]
NewOwner = Annotated[
    str | None, typer.Option("--owner", metavar="NAME", help='The new owner; "" for none.')
]
AddedLabels = Annotated[
    list[str] | None,
    typer.Option("--label", metavar="LABEL", help="Label to add; repeatable."),
]
RemovedLabels = Annotated[
    list[str] | None,
    typer.Option("--remove-label", metavar="LABEL", help="Label to remove; repeatable."),
]
NewTicket = Annotated[
    str | None,
    typer.Option("--ticket", metavar="URL", help='Address of its ticket; "" for none.'),
]
Filter = Annotated[
    str | None,
    typer.Option("--filter", help='Conditions, such as "mode = 2"; "" for every episode.'),
]
Text = Annotated[str, typer.Argument(metavar="TEXT", help="The note.")]


def triage_modes(
    context: typer.Context,
    analysis: AnalysisId,
    numbers: ModeNumbers,
    state: NewState = None,
    owner: NewOwner = None,
    labels: AddedLabels = None,
    removed: RemovedLabels = None,
    ticket: NewTicket = None,
    url: Url = DEFAULT_URL,
    as_json: AsJson = False,
) -> None:
    """Change state, owner, labels or ticket of failure modes: of each one named, or of none."""
    fields = _read_fields(state, owner, ticket) | _read_labels(labels, removed)
    _refuse_nothing(fields)
    with connect_to(context, url) as client:
        count = client.triage.change_modes(analysis, numbers, **fields)
    show(count, as_json, lambda: _describe_count(count, "mode"))


def triage_episodes(
    context: typer.Context,
    triaged: Triaged,
    conditions: Filter = None,
    state: NewState = None,
    owner: NewOwner = None,
    labels: AddedLabels = None,
    removed: RemovedLabels = None,
    ticket: NewTicket = None,
    url: Url = DEFAULT_URL,
    as_json: AsJson = False,
) -> None:
    """Change state, owner, labels or ticket of an episode, or of each one that matches a filter."""
    fields = _read_fields(state, owner, ticket) | _read_labels(labels, removed)
    _refuse_nothing(fields)
    campaign, text = _read_selection(triaged, conditions)
    with connect_to(context, url) as client:
        count = client.triage.change_episodes(campaign, text, **fields)
        if not count.matched and "/" in triaged:
            client.triage.get_episode(*parse_episode_id(triaged))  # says why there is none
    show(count, as_json, lambda: _describe_count(count, "episode"))


def add_mode_note(
    context: typer.Context,
    analysis: AnalysisId,
    number: ModeNumber,
    text: Text,
    url: Url = DEFAULT_URL,
    as_json: AsJson = False,
) -> None:
    """Add a note to a failure mode."""
    with connect_to(context, url) as client:
        _show_note(client.triage.add_mode_note(analysis, number, text), as_json)


def add_episode_note(
    context: typer.Context,
    episode: EpisodeId,
    text: Text,
    url: Url = DEFAULT_URL,
    as_json: AsJson = False,
) -> None:
    """Add a note to an episode."""
    campaign, index = parse_episode_id(episode)
    with connect_to(context, url) as client:
        _show_note(client.triage.add_episode_note(campaign, index, text), as_json)


def show_mode_triage(
    context: typer.Context,
    analysis: AnalysisId,
    number: ModeNumber,
    url: Url = DEFAULT_URL,
    limit: Limit = 20,
    as_json: AsJson = False,
) -> None:
    """Show the triage of a failure mode, and its notes, newest first."""
    with connect_to(context, url) as client:
        found = client.triage.get_mode(analysis, number)
        notes = client.triage.list_mode_notes(analysis, number).first(limit)
    _show_triage(found, notes, as_json)


def show_episode_triage(
    context: typer.Context,
    episode: EpisodeId,
    url: Url = DEFAULT_URL,
    limit: Limit = 20,
    as_json: AsJson = False,
) -> None:
    """Show the triage of an episode, and its notes, newest first."""
    campaign, index = parse_episode_id(episode)
    with connect_to(context, url) as client:
        found = client.triage.get_episode(campaign, index)
        notes = client.triage.list_episode_notes(campaign, index).first(limit)
    _show_triage(found, notes, as_json)


def _read_fields(state: TriageState | None, owner: str | None, ticket: str | None) -> TriageFields:
    fields = TriageFields()
    if state is not None:
        fields["state"] = state
    if owner is not None:
        fields["owner"] = owner
    if ticket is not None:
        fields["ticket"] = ticket
    return fields


def _read_labels(added: list[str] | None, removed: list[str] | None) -> TriageFields:
    fields = TriageFields()
    if added:
        fields["add_labels"] = added
    if removed:
        fields["remove_labels"] = removed
    return fields


def _refuse_nothing(fields: TriageFields) -> None:
    if not fields:
        remedy = "Give --state, --owner, --label, --remove-label or --ticket."
        raise InvalidValue("options", "nothing is to be changed.", remedy)


def _read_selection(triaged: str, conditions: str | None) -> tuple[int, str]:
    """Return the campaign, and the filter that selects its episodes."""
    if "/" in triaged:
        campaign, index = parse_episode_id(triaged)
        if conditions is not None:
            problem = "it applies to the episodes of a campaign, not to one episode."
            raise InvalidValue("--filter", problem, "Leave it out.")
        return campaign, f"index = {index}"
    if not triaged.isdecimal() or not int(triaged):
        problem = f"'{triaged}' is neither a campaign, such as 3, nor an episode, such as 3/17."
        raise InvalidValue("campaign", problem)
    if conditions is None:
        raise InvalidValue("--filter", "it is missing.", 'Write --filter "" for every episode.')
    return int(triaged), conditions


def _describe_count(count: TriageCount, noun: str) -> str:
    several = "" if count.matched == 1 else "s"
    return f"Triage changed for {count.changed:,} of {count.matched:,} {noun}{several}."


def _show_note(note: TriageNote, as_json: bool) -> None:
    if as_json:
        typer.echo(to_json(note))
        return
    make_console().print(f"Note {note.id} of {escape(note.author)} was added.")


def _show_triage(found: Triage, notes: Sequence[TriageNote], as_json: bool) -> None:
    data = {"triage": found, "notes": list(notes)}
    show(data, as_json, lambda: _draw_triage(found, notes))


def _draw_triage(found: Triage, notes: Sequence[TriageNote]) -> RenderableType:
    changed = "" if found.changed_ms is None else format_local_time(found.changed_ms)
    facts = (
        ("state", found.state.words),
        ("owner", found.owner or "none"),
        ("labels", ", ".join(found.labels) or "none"),
        ("ticket", found.ticket or "none"),
        ("changed", f"{changed}, by {found.changed_by}" if changed else "never"),
    )
    columns = tuple(TableColumn(title, is_figure=False) for title in ("Time", "Author", "Note"))
    rows = tuple((format_local_time(note.at_ms), note.author, note.text) for note in notes)
    return render(FactTable("Triage", facts), *([Table("Notes", columns, rows)] if rows else []))
