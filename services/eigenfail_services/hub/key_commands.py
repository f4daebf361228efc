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

from eigenfail.cli.key import parse_duration
from eigenfail.cli.options import AsJson, Data
from eigenfail.cli.render import show, to_json
from eigenfail.errors import EigenfailError
from eigenfail.files import read_private, replace_private
from eigenfail.hosting.folder import DEFAULT_DATA, DataFolder
from eigenfail.hosting.service import require_installed
from eigenfail.presentation import tables
from eigenfail.presentation.figures import format_utc
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
    help="Create, rotate, list and revoke keys of workers.\n\n"
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
    typer.Option("--file", help="File to which the key is written (default: NAME.key)."),
]
Expires = Annotated[
    str | None,
    typer.Option(help="Lifetime: 90d, 12h, 30m (default: until revoked)."),
]
KeepOld = Annotated[
    str | None,
    typer.Option(help="Time for which the old key stays valid: 1d, 12h (default: none)."),
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
    """Create a key, and write it to a file for one worker, or for several that share it.

    The file is secret, and the only copy of the key.
    """
    written = file or Path(f"{name}.key")
    until_ms = _find_expiry_ms(expires)
    with _open_folder(data, folder) as keys:
        # A key that exists already is left as it is, and is no change for the audit log.
        is_known = keys.knows(name)
        made = keys.create(name, written, until_ms)
    if not is_known:
        _record_change(data, folder, "POST", "/worker-keys", f"/worker-keys/{name}", CREATED)
    if made.new_hub:
        typer.echo(
            f"The hub had no key in {keys.path}: a new one was made there, {made.new_hub}. "
            "Workers with keys for another hub are refused.",
            err=True,
        )
    typer.echo(to_json(made.worker) if as_json else _describe_new_key(made.worker, written))


@app.command("list")
def list_keys(folder: Folder = None, data: Data = DEFAULT_DATA, as_json: AsJson = False) -> None:
    """List the keys that the hub accepts and expired ones, by name."""
    with _open_folder(data, folder) as keys:
        found = keys.list()
    show(found, as_json, _tabulate_keys(found))


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
    """Replace a key by a new one of the same name.

    Workers with the old key are disconnected within seconds, or after --keep-old.
    """
    written = file or Path(f"{name}.key")
    keep_until_ms, until_ms = _find_expiry_ms(keep_old), _find_expiry_ms(expires)
    with _open_folder(data, folder) as keys:
        made = keys.rotate(name, written, until_ms, keep_until_ms or 0)
    subject = f"/worker-keys/{name}"
    _record_change(data, folder, "POST", "/worker-keys/{name}/rotations", subject, CREATED)
    typer.echo(to_json(made.worker) if as_json else _describe_new_key(made.worker, written))


@app.command("rotate-hub")
def rotate_hub(folder: Folder = None, data: Data = DEFAULT_DATA, as_json: AsJson = False) -> None:
    """Create a new key for the hub, which it uses after its next start.

    Workers' keys stay valid, but need `worker key follow` to know the hub's new key.
    """
    with _open_folder(data, folder) as keys:
        made = keys.rotate_hub()
    _record_change(data, folder, "POST", "/hub-key", "/hub-key", CREATED)
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
    """Write the hub's new public key into a worker's key file; then restart the worker.

    The hub's public key is not a secret, but get it from a trusted source: it identifies the hub.
    """
    key = read_worker_key(read_private(file, "FILE"), "FILE")
    replace_private(file, key.following(read_hub_key(hub, "HUB")).text(), "FILE")
    typer.echo(f"{file} knows the hub by its new key.")


@app.command()
def revoke(
    name: Name, folder: Folder = None, data: Data = DEFAULT_DATA, as_json: AsJson = False
) -> None:
    """Revoke a key permanently; its workers are disconnected within seconds."""
    with _open_folder(data, folder) as keys:
        revoked = keys.revoke(name)
    _record_change(data, folder, "DELETE", "/worker-keys/{name}", f"/worker-keys/{name}", DONE)
    words = f"Key {revoked.key} of '{name}' is revoked; workers that use it are disconnected."
    typer.echo(to_json(revoked) if as_json else words)


@contextmanager
def _open_folder(data: Path, folder: Path | None) -> Iterator["KeyFolder"]:
    require_installed()
    from eigenfail_services.hub.keys import KeyFolder, unusable_folder

    path = folder or DataFolder(data).hub_keys
    try:
        yield KeyFolder(path)
    except OSError as error:
        raise unusable_folder(path, error) from error


def _record_change(
    data: Path, folder: Path | None, method: str, route: str, subject: str, status: int
) -> None:
    """Write a line of the audit log, or the reason why there is none to standard error.

    It goes to the database that the environment names, or else to the data folder's.
    """
    from eigenfail_services.store.store import open_store

    service = DataFolder(data)
    url = os.environ.get(DATABASE_VARIABLE)
    # A folder of keys that was named may be another service's, whose database is not known
    # here.
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


def _find_expiry_ms(life: str | None) -> int | None:
    """Return when a key with a lifetime such as 90d expires. [ms since 1970]"""
    return None if life is None else round(1_000 * time()) + 1_000 * parse_duration(life)


def _describe_new_key(made: AllowedWorker, written: Path) -> str:
    until = "" if made.until_ms is None else f", until {format_utc(made.until_ms)}"
    return (
        f"Key {made.key} for '{made.name}' is in {written}{until}. Copy this file to the worker's "
        "machine, then there:\n\n"
        f"eigenfail worker --connect tcp://HOST:PORT --key-file {written.name}"
    )


def _tabulate_keys(keys: Iterable[AllowedWorker]) -> tables.Table:
    at_ms = round(1_000 * time())
    return tables.tabulate(
        "Keys",
        keys,
        tables.read_text("Name", "name"),
        tables.read_text("Key", "key"),
        tables.read_text("State", lambda key: "valid" if key.is_valid(at_ms) else "expired"),
        tables.read_utc("Made", "made_ms"),
        tables.read_utc("Ends", "until_ms"),
    )
