"""`eigenfail worker key`: which workers a hub lets in."""

from collections.abc import Iterable
from pathlib import Path
from time import time
from typing import Annotated

import typer
from rich.markup import escape
from rich.table import Table

from eigenfail.cli.figures import UNKNOWN
from eigenfail.cli.key import seconds
from eigenfail.cli.moments import utc
from eigenfail.cli.options import DEFAULT_DATA, AsJson, Data
from eigenfail.cli.output import show, to_json
from eigenfail.cli.tables import table
from eigenfail.hosting.folder import DataFolder
from eigenfail.hosting.worker_keys import WorkerKeys, follow
from eigenfail.wire.curve import AllowedWorker

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    help="Make, renew, list and revoke the keys of workers.\n\n"
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


Expires = Annotated[
    str | None,
    typer.Option(help="How long it is let in: 90d, 12h, 30m; until revoked if left out."),
]
KeepOld = Annotated[
    str | None,
    typer.Option(help="How long the old key is let in as well: 1d, 12h; no more if left out."),
]


@app.command()
def create(
    name: Name,
    file: File = None,
    expires: Expires = None,
    folder: Folder = None,
    data: Data = DEFAULT_DATA,
    as_json: AsJson = False,
) -> None:
    """Make a key, and write it to a file for one worker, or for several that are revoked together.

    The file is a secret: nothing else holds what is in it.
    """
    written = file or Path(f"{name}.key")
    made = WorkerKeys(data, folder).create(name, written, seconds_of(expires))
    if made.new_hub:
        where = folder or DataFolder(data).hub_keys
        typer.echo(FIRST.format(where=where, hub=made.new_hub), err=True)
    typer.echo(to_json(made.worker) if as_json else carried(made.worker, written))


@app.command("list")
def list_keys(folder: Folder = None, data: Data = DEFAULT_DATA, as_json: AsJson = False) -> None:
    """List the keys that the hub lets in, by name; those that have ended, too."""
    found = WorkerKeys(data, folder).list()
    show(found, as_json, lambda: key_table(found))


@app.command()
def rotate(
    name: Name,
    file: File = None,
    expires: Expires = None,
    keep_old: KeepOld = None,
    folder: Folder = None,
    data: Data = DEFAULT_DATA,
    as_json: AsJson = False,
) -> None:
    """Make another key of the same name, in the place of the old one.

    Who works with the old one is cut off within seconds, or when --keep-old is over.
    """
    written = file or Path(f"{name}.key")
    kept_s = seconds_of(keep_old)
    made = WorkerKeys(data, folder).rotate(name, written, seconds_of(expires), kept_s)
    typer.echo(to_json(made.worker) if as_json else carried(made.worker, written))


@app.command("rotate-hub")
def rotate_hub(folder: Folder = None, data: Data = DEFAULT_DATA, as_json: AsJson = False) -> None:
    """Make the hub another key, which it takes with its next start.

    Who is let in stays so, but knows the hub by its old key, until `worker key follow`.
    """
    made = WorkerKeys(data, folder).rotate_hub()
    words = (
        f"The hub's key is {made.key} from its next start on. Beside each worker's file, run:\n\n"
        f"eigenfail worker key follow FILE {made.hub}"
    )
    typer.echo(to_json(made) if as_json else words)


@app.command("follow")
def follow_hub(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="Of a worker's key.")],
    hub: Annotated[str, typer.Argument(metavar="HUB", help="The hub's new public key, efh_….")],
) -> None:
    """Have a worker's key, in a file, know the hub by its new one; the worker is then restarted.

    The hub's key is no secret, but take it from whoever made it: a worker works for that hub alone.
    """
    follow(file, hub)
    typer.echo(f"{file} knows the hub by its new key.")


@app.command()
def revoke(
    name: Name, folder: Folder = None, data: Data = DEFAULT_DATA, as_json: AsJson = False
) -> None:
    """Revoke a key, for good: who works with it is cut off within seconds."""
    revoked = WorkerKeys(data, folder).revoke(name)
    words = f"Key {revoked.key} of '{name}' is revoked; who works with it is cut off."
    typer.echo(to_json(revoked) if as_json else words)


FIRST = (
    "The hub had no key in {where}: a new one was made there, {hub}. Workers of another hub do "
    "not get in with theirs."
)


def carried(made: AllowedWorker, written: Path) -> str:
    """Where a key is, and what to do with it."""
    until = "" if made.until_ms is None else f", until {utc(made.until_ms)} UTC"
    return (
        f"Key {made.key} for '{made.name}' is in {written}{until}. Carry that file to the worker's "
        "machine, then there:\n\n"
        f"eigenfail worker --connect tcp://HOST:PORT --key-file {written.name}"
    )


def seconds_of(life: str | None) -> int | None:
    """A time such as 90d, if there is one; raises InvalidValue if it is not written like that."""
    return None if life is None else seconds(life)


def key_table(keys: Iterable[AllowedWorker]) -> Table:
    """One row for each key; times in UTC."""
    at_ms = round(1_000 * time())
    grid = table("name", "key", "state", "made", "ends")
    for key in keys:
        state = "valid" if key.is_valid(at_ms) else "expired"
        ends = UNKNOWN if key.until_ms is None else utc(key.until_ms)
        grid.add_row(escape(key.name), key.key, state, utc(key.made_ms), ends)
    return grid
