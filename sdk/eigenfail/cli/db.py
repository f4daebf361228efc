"""`eigenfail db`: the database's schema."""

from typing import Annotated

import typer

from eigenfail.cli.options import DEFAULT_DATA, AsJson, Data
from eigenfail.cli.output import to_json
from eigenfail.hosting.folder import DataFolder
from eigenfail.hosting.service import database_tool

app = typer.Typer(
    add_completion=False, no_args_is_help=True, help="Create, upgrade and check a database."
)

Database = Annotated[
    str | None,
    typer.Option(
        "--database",
        envvar="EIGENFAIL_DATABASE",
        help="SQLAlchemy URL, instead of the data folder's database.",
    ),
]


@app.command()
def upgrade(database: Database = None, data: Data = DEFAULT_DATA, as_json: AsJson = False) -> None:
    """Create the schema, or bring it up to this program's."""
    tell("upgrade", database, data, as_json)


@app.command()
def current(database: Database = None, data: Data = DEFAULT_DATA, as_json: AsJson = False) -> None:
    """Print the schema's revision."""
    tell("current", database, data, as_json)


@app.command()
def check(database: Database = None, data: Data = DEFAULT_DATA, as_json: AsJson = False) -> None:
    """Say whether the schema is this program's; exit with 3 if not."""
    tell("check", database, data, as_json)


WORDS = {
    "upgrade": "The database's schema is at revision {}, which is this program's.",
    "check": "The database's schema is this program's: revision {}.",
}
"""What is said of a revision; of others, it alone."""


def tell(action: str, database: str | None, data: Data, as_json: bool) -> None:
    """Run the database's own tool, and print the revision that it says."""
    said = database_tool(action, database or DataFolder(data).database)
    typer.echo(
        to_json({"action": action, "said": said})
        if as_json
        else WORDS.get(action, "{}").format(said)
    )
