"""`eigenfail worker key`: which workers a hub lets in."""

from collections.abc import Iterable
from pathlib import Path
from typing import Annotated

import typer
from rich.markup import escape
from rich.table import Table

from eigenfail.cli.moments import utc
from eigenfail.cli.options import DEFAULT_DATA, AsJson, Data
from eigenfail.cli.output import show, to_json
from eigenfail.cli.tables import table
from eigenfail.hosting.folder import DataFolder
from eigenfail.hosting.worker_keys import WorkerKeys
from eigenfail.wire.curve import AllowedWorker

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    help="Make, list and revoke the keys of workers.\n\n"
    "With keys, a hub speaks over encrypted connections (CURVE), with the workers alone whose keys "
    "it lets in. It needs them wherever other machines reach it. The first key is the beginning: "
    "a hub that runs without keys asks for them after its next start.",
)

Name = Annotated[str, typer.Argument(metavar="NAME", help="What the key is called.")]
Folder = Annotated[
    Path | None,
    typer.Option(
        "--hub-keys",
        envvar="EIGENFAIL_HUB_KEYS",
        help="Folder of the hub's keys, instead of the data folder's.",
    ),
]
File = Annotated[
    Path | None, typer.Option("--file", help="Where the key is written; NAME.key if left out.")
]


@app.command()
def create(
    name: Name,
    file: File = None,
    folder: Folder = None,
    data: Data = DEFAULT_DATA,
    as_json: AsJson = False,
) -> None:
    """Make a key, and write it to a file for one worker, or for several that are revoked together.

    The file is a secret: nothing else holds what is in it.
    """
    written = file or Path(f"{name}.key")
    made = keys_in(folder, data).create(name, written)
    words = (
        f"Key {made.key} for '{name}' is in {written}. Carry that file to the worker's machine, "
        "then there:\n\n"
        f"eigenfail worker --connect tcp://HOST:PORT --key-file {written.name}"
    )
    typer.echo(to_json(made) if as_json else words)


@app.command("list")
def list_keys(folder: Folder = None, data: Data = DEFAULT_DATA, as_json: AsJson = False) -> None:
    """List the keys that the hub lets in, by name."""
    found = keys_in(folder, data).list()
    show(found, as_json, lambda: key_table(found))


@app.command()
def revoke(
    name: Name, folder: Folder = None, data: Data = DEFAULT_DATA, as_json: AsJson = False
) -> None:
    """Revoke a key, for good: nobody gets in with it from now on.

    Who is connected stays until the connection ends; starting the service again cuts it.
    """
    revoked = keys_in(folder, data).revoke(name)
    words = f"Key {revoked.key} of '{name}' is revoked. A start of the service cuts who is in."
    typer.echo(to_json(revoked) if as_json else words)


def keys_in(folder: Path | None, data: Path) -> WorkerKeys:
    """The keys in a folder; without one, those of the service on the data folder."""
    return WorkerKeys(folder or DataFolder(data).hub_keys)


def key_table(keys: Iterable[AllowedWorker]) -> Table:
    """One row for each key; times in UTC."""
    grid = table("name", "key", "made")
    for key in keys:
        grid.add_row(escape(key.name), key.key, utc(key.made_ms))
    return grid
