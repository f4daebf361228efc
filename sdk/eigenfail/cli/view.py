"""`eigenfail view`: save, list, rename and delete views of lists."""

from collections.abc import Iterable, Mapping
from typing import Annotated, Any

import typer
from rich.markup import escape
from rich.table import Table

from eigenfail.cli.connection import connect_to
from eigenfail.cli.options import AsJson, Url
from eigenfail.cli.render import make_console, show, to_json
from eigenfail.client.client import Client
from eigenfail.errors import InvalidValue
from eigenfail.hosting.folder import DEFAULT_URL
from eigenfail.presentation.figures import format_utc
from eigenfail.presentation.terminal import start_grid
from eigenfail.views import SavedView, ViewPage, require_page

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    help="Save, list, rename and delete views: lists with their filter and order.\n\n"
    "All users of a service share its views. `campaign list`, `episode list` and "
    "`episode failures` take --view.",
)

Name = Annotated[str, typer.Argument(metavar="NAME", help="Name of the view.")]
NewName = Annotated[str, typer.Argument(metavar="NEW_NAME", help="New name of the view.")]
OfPage = Annotated[
    ViewPage, typer.Argument(metavar="PAGE", help="List: campaigns, episodes or failures.")
]
OnlyPage = Annotated[ViewPage | None, typer.Option("--page", help="Only views of this list.")]
Parameters = Annotated[
    list[str] | None,
    typer.Option(
        "--set",
        metavar="FIELD=VALUE",
        help='Parameter of the list, such as "filter=severity > 80", sort=-severity or '
        "state=running; repeatable.",
    ),
]


@app.command("list")
def list_views(
    context: typer.Context,
    page: OnlyPage = None,
    url: Url = DEFAULT_URL,
    as_json: AsJson = False,
) -> None:
    """List saved views, newest first."""
    with connect_to(context, url) as client:
        found = tuple(client.views.list(page))
    show(found, as_json, lambda: _draw_views(found))


@app.command()
def save(
    context: typer.Context,
    name: Name,
    page: OfPage,
    parameters: Parameters = None,
    url: Url = DEFAULT_URL,
    as_json: AsJson = False,
) -> None:
    """Save a view of a list under a new name."""
    query = _parse_parameters(parameters or ())
    with connect_to(context, url) as client:
        made = client.views.save(name, page, **query)
    show(made, as_json, lambda: _draw_views([made]))


@app.command()
def rename(
    context: typer.Context,
    name: Name,
    new_name: NewName,
    url: Url = DEFAULT_URL,
    as_json: AsJson = False,
) -> None:
    """Give a view another name."""
    with connect_to(context, url) as client:
        found = client.views.rename(name, new_name)
    show(found, as_json, lambda: _draw_views([found]))


@app.command()
def delete(
    context: typer.Context, name: Name, url: Url = DEFAULT_URL, as_json: AsJson = False
) -> None:
    """Delete a view; what it lists stays."""
    with connect_to(context, url) as client:
        found = client.views.delete(name)
    if as_json:
        typer.echo(to_json(found))
        return
    make_console().print(f"View '{escape(found.name)}' was deleted.")


def read_view(
    client: Client, name: str | None, page: ViewPage, given: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the keyword arguments of a list: those of the command line, and others of the view.

    Args:
        client: the service.
        name: name of the view; None for none.
        page: the list.
        given: arguments of the command line; those that are None are not given.

    Raises:
        NotFound: no such view.
        InvalidValue: the view is of another list.
    """
    options = {} if name is None else require_page(client.views.get(name), page).options
    return options | {field: value for field, value in given.items() if value is not None}


def _parse_parameters(given: Iterable[str]) -> dict[str, str]:
    query: dict[str, str] = {}
    for each in given:
        field, equals, value = each.partition("=")
        if not field.strip() or not equals:
            problem = f"'{each}' is not of the form FIELD=VALUE."
            raise InvalidValue("--set", problem, "Write it as sort=-severity.")
        query[field.strip()] = value
    return query


def _draw_views(found: Iterable[SavedView]) -> Table:
    """A row for each view; times in UTC."""
    grid = start_grid("name", "page", "parameters", "author", "saved")
    for view in found:
        parameters = ", ".join(f"{field}={value}" for field, value in view.query.items())
        cells = (view.name, view.page.value, parameters, view.author, format_utc(view.saved_ms))
        grid.add_row(*map(escape, cells))
    return grid
