"""`eigenfail db`: the database itself."""

from contextlib import nullcontext
from pathlib import Path
from typing import Annotated

import typer

from eigenfail.cli.db_options import Database, Force, Repair, Replay, said, verified
from eigenfail.cli.db_room import downgrade, prune, vacuum
from eigenfail.cli.db_tables import verification
from eigenfail.cli.options import DEFAULT_DATA, AsJson, Data
from eigenfail.cli.output import show, to_json
from eigenfail.hosting.folder import DataFolder
from eigenfail.hosting.service import database_tool
from eigenfail.values.upkeep import Backup

WRONG = 1

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    help="Create, upgrade, check, back up, restore and thin out a database.",
)

File = Annotated[Path, typer.Argument(metavar="FILE", help="The backup.")]


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


@app.command()
def verify(
    database: Database = None,
    data: Data = DEFAULT_DATA,
    replay: Replay = 0,
    repair: Repair = False,
    as_json: AsJson = False,
) -> None:
    """Hold all that is in a database against what is promised of it; exit with 1 if not.

    A service may use it meanwhile.
    """
    found = verified(database or DataFolder(data).database, replay, repair)
    show(found, as_json, lambda: verification(found))
    if found.defects:
        raise typer.Exit(WRONG)


@app.command()
def backup(
    file: File,
    database: Database = None,
    data: Data = DEFAULT_DATA,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Write all that is in a database to a file; a service may use it meanwhile.

    The file is there once it is whole and checked. SQLite gives a database file; PostgreSQL a dump
    by pg_dump, which must be installed.
    """
    where = database or DataFolder(data).database
    made = said(Backup, "backup", where, f"--file={file}", *["--force"] * force)
    told = f"{made.file} holds all of {made.database} ({made.bytes} bytes)."
    typer.echo(to_json(made) if as_json else told)


@app.command()
def restore(
    file: File,
    database: Database = None,
    data: Data = DEFAULT_DATA,
    force: Force = False,
    as_json: AsJson = False,
) -> None:
    """Put a backup into an empty database, or with --force in the place of what is there.

    All of it is restored, or nothing is changed. Nobody may use the database meanwhile.
    """
    folder = DataFolder(data)
    with nullcontext() if database else folder.claimed():
        where = database or folder.database
        done = said(Backup, "restore", where, f"--file={file}", *["--force"] * force)
    told = f"{done.database} holds what {done.file} held (schema {done.revision})."
    typer.echo(to_json(done) if as_json else told)


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


for page in (prune, vacuum, downgrade):
    app.command()(page)
