"""`eigenfail worker key`: the keys of the workers that a hub lets in, in the hub's folder."""

import getpass
import os
import platform
from collections.abc import Iterable, Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from time import time
from typing import TYPE_CHECKING, Annotated

import typer
from rich.markup import escape
from rich.table import Table

from eigenfail.cli.key import parse_duration
from eigenfail.cli.options import AsJson, Data
from eigenfail.cli.render import show, to_json
from eigenfail.errors import EigenfailError
from eigenfail.files import read_private, replace_private
from eigenfail.hosting.folder import DEFAULT_DATA, DataFolder
from eigenfail.hosting.service import require_installed
from eigenfail.presentation.figures import UNKNOWN, format_utc
from eigenfail.presentation.terminal import start_grid
from eigenfail.values.access import Change, redact
from eigenfail.wire.keys import AllowedWorker, read_hub_key, read_worker_key

if TYPE_CHECKING:
    from eigenfail_services.hub.keys import KeyFolder

# ZeroMQ and the store are imported by the commands that need them: `follow` runs on a worker's
# machine, which has no store.

DATABASE_VARIABLE = "EIGENFAIL_DATABASE"
CREATED, DONE = 201, 200

app = typer.Typer(
    add_completion=False,
    no_args_is_help=True,
    help="Make, renew, list and revoke the keys of workers.\n\n"
    "With keys, a hub speaks over encrypted connections (CURVE), with the workers alone whose keys "
    "it lets in. It needs them wherever other machines reach it. The first key is the beginning: "
    "a hub that runs without keys asks for them after its next start.",
)

Name = Annotated[str, typer.Argument(metavar="NAME", help="Name of the key.")]
Folder = Annotated[
    Path | None,
    typer.Option(
        "--hub-keys",
        envvar="EIGENFAIL_HUB_KEYS",
        help="Folder of the hub's keys, instead of the data folder's.",
    ),
]
File = Annotated[
    Path | None,
    typer.Option("--file", help="File to which the key is written; NAME.key if left out."),
]
Expires = Annotated[
    str | None,
    typer.Option(help="How long the key is valid: 90d, 12h, 30m; until revoked if left out."),
]
KeepOld = Annotated[
    str | None,
    typer.Option(help="How long the old key stays valid: 1d, 12h; no longer if left out."),
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
    until_ms = _end_of(expires)
    with _opened(data, folder) as keys:
        is_known = keys.knows(name)
        made = keys.create(name, written, until_ms)
    if not is_known:
        _note(data, folder, "POST", "/worker-keys", f"/worker-keys/{name}", CREATED)
    if made.new_hub:
        typer.echo(
            f"The hub had no key in {keys.path}: a new one was made there, {made.new_hub}. "
            "Workers of another hub do not get in with theirs.",
            err=True,
        )
    typer.echo(to_json(made.worker) if as_json else _describe_new_key(made.worker, written))


@app.command("list")
def list_keys(folder: Folder = None, data: Data = DEFAULT_DATA, as_json: AsJson = False) -> None:
    """List the keys that the hub lets in, by name; those that have ended, too."""
    with _opened(data, folder) as keys:
        found = keys.list()
    show(found, as_json, lambda: _draw_keys(found))


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
    keep_until_ms, until_ms = _end_of(keep_old), _end_of(expires)
    with _opened(data, folder) as keys:
        made = keys.rotate(name, written, until_ms, keep_until_ms or 0)
    subject = f"/worker-keys/{name}"
    _note(data, folder, "POST", "/worker-keys/{name}/rotations", subject, CREATED)
    typer.echo(to_json(made.worker) if as_json else _describe_new_key(made.worker, written))


@app.command("rotate-hub")
def rotate_hub(folder: Folder = None, data: Data = DEFAULT_DATA, as_json: AsJson = False) -> None:
    """Make the hub another key, which it takes with its next start.

    Who is let in stays so, but knows the hub by its old key, until `worker key follow`.
    """
    with _opened(data, folder) as keys:
        made = keys.rotate_hub()
    _note(data, folder, "POST", "/hub-key", "/hub-key", CREATED)
    words = (
        f"The hub's key is {made.key} from its next start on. Beside each worker's file, run:\n\n"
        f"eigenfail worker key follow FILE {made.hub}"
    )
    typer.echo(to_json(made) if as_json else words)


@app.command()
def follow(
    file: Annotated[Path, typer.Argument(metavar="FILE", help="File of a worker's key.")],
    hub: Annotated[str, typer.Argument(metavar="HUB", help="The hub's new public key, efh_….")],
) -> None:
    """Have a worker's key, in a file, know the hub by its new one; the worker is then restarted.

    The hub's key is no secret, but take it from whoever made it: a worker works for that hub alone.
    """
    key = read_worker_key(read_private(file, "FILE"), "FILE")
    replace_private(file, key.following(read_hub_key(hub, "HUB")).text(), "FILE")
    typer.echo(f"{file} knows the hub by its new key.")


@app.command()
def revoke(
    name: Name, folder: Folder = None, data: Data = DEFAULT_DATA, as_json: AsJson = False
) -> None:
    """Revoke a key, for good: who works with it is cut off within seconds."""
    with _opened(data, folder) as keys:
        revoked = keys.revoke(name)
    _note(data, folder, "DELETE", "/worker-keys/{name}", f"/worker-keys/{name}", DONE)
    words = f"Key {revoked.key} of '{name}' is revoked; who works with it is cut off."
    typer.echo(to_json(revoked) if as_json else words)


@contextmanager
def _opened(data: Path, folder: Path | None) -> Iterator["KeyFolder"]:
    require_installed()
    from eigenfail_services.hub.keys import KeyFolder, unusable_folder

    path = folder or DataFolder(data).hub_keys
    try:
        yield KeyFolder(path)
    except OSError as error:
        raise unusable_folder(path, error) from error


def _note(
    data: Path, folder: Path | None, method: str, route: str, subject: str, status: int
) -> None:
    """Write a line of the audit log, or the reason why there is none to standard error.

    It goes to the database that the environment names, or else to the data folder's.
    """
    from eigenfail_services.store import open_store

    service = DataFolder(data)
    url = os.environ.get(DATABASE_VARIABLE)
    if not url and folder is None and service.database_file.exists():
        url = service.database
    if not url:
        return
    change = Change(find_user(), None, method, route, subject, platform.node(), status)
    try:
        with closing(open_store(url, migrate=False)) as store:
            store.audit.append(change)
    except EigenfailError as error:
        words = f"The change of {subject} is not in the audit log: {error}"
        typer.echo(redact(words), err=True)


def find_user() -> str:
    """Return the name of the system's user who runs this process, or the number of one without."""
    try:
        return getpass.getuser()
    except (KeyError, OSError):
        return str(os.getuid())


def _end_of(life: str | None) -> int | None:
    # In milliseconds since 1970, from a duration such as 90d.
    return None if life is None else round(1_000 * time()) + 1_000 * parse_duration(life)


def _describe_new_key(made: AllowedWorker, written: Path) -> str:
    until = "" if made.until_ms is None else f", until {format_utc(made.until_ms)}"
    return (
        f"Key {made.key} for '{made.name}' is in {written}{until}. Carry that file to the worker's "
        "machine, then there:\n\n"
        f"eigenfail worker --connect tcp://HOST:PORT --key-file {written.name}"
    )


def _draw_keys(keys: Iterable[AllowedWorker]) -> Table:
    at_ms = round(1_000 * time())
    grid = start_grid("name", "key", "state", "made", "ends")
    for key in keys:
        state = "valid" if key.is_valid(at_ms) else "expired"
        ends = UNKNOWN if key.until_ms is None else format_utc(key.until_ms)
        grid.add_row(escape(key.name), key.key, state, format_utc(key.made_ms), ends)
    return grid
