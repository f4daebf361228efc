"""`python -m eigenfail_services worker-key …`: workers' keys in the hub's folder; prints JSON."""

import argparse
import getpass
import os
import platform
import sys
from collections.abc import Callable, Mapping
from contextlib import closing
from pathlib import Path
from typing import NamedTuple

import msgspec
import structlog

from eigenfail.errors import EigenfailError, InvalidValue
from eigenfail.values.access import Change
from eigenfail_services.hub.binding import KEYS_VARIABLE
from eigenfail_services.hub.keys import FIELD, KeyFolder, closed_to_us
from eigenfail_services.store import open_store
from eigenfail_services.store.clock import now_ms

OF_WORKERS, OF_HUB = "worker-key", "hub-key"
MADE, DONE = 201, 200

log = structlog.get_logger()


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """What the command line takes."""
    parser.add_argument("action", choices=ACTIONS)
    parser.add_argument("--name", default="", help="of a key")
    parser.add_argument("--file", type=Path, help="to which a new key is written")
    parser.add_argument("--expires-s", type=int, help="how long a new key is let in")
    parser.add_argument("--keep-s", type=int, help="how long the key is that a new one replaces")
    parser.add_argument(FIELD, type=Path, default=argparse.SUPPRESS, help="folder of its keys")
    parser.set_defaults(command=tend_keys)


def default_folder() -> Path | None:
    """The folder of keys that the environment names."""
    named = os.environ.get(KEYS_VARIABLE)
    return Path(named) if named else None


def tend_keys(arguments: argparse.Namespace) -> None:
    """Do what the command line says, print the answer, and note what was changed.

    Raises:
        InvalidValue: no folder is named, or what was asked for cannot be done.
    """
    if arguments.hub_keys is None:
        raise InvalidValue(FIELD, "is not given.", "Name the folder of the hub's keys.")
    action, folder = ACTIONS[arguments.action], KeyFolder(arguments.hub_keys)
    try:
        is_known = action.keeps and folder.knows(arguments.name)
        found = action.run(folder, arguments)
    except OSError as error:
        raise closed_to_us(arguments.hub_keys, error) from error
    if action.change is not None and arguments.database and not is_known:
        note(arguments.database, action.change(arguments.name))
    sys.stdout.write(msgspec.json.encode(found).decode() + "\n")


def note(database: str, change: Change) -> None:
    """Write a line into the audit log; into this process's, if the database is not there."""
    try:
        with closing(open_store(database, migrate=False)) as store:
            store.audit.append(change)
    except EigenfailError as error:
        told = msgspec.structs.asdict(change)
        log.warning("not in the audit log", problem=str(error), **told)


def changing(method: str, varying: str, status: int) -> Callable[[str], Change]:
    """What the audit log tells of a change by whoever is at work on this machine."""

    def of(name: str) -> Change:
        route, subject = f"/{OF_WORKERS}s{varying}", f"/{OF_WORKERS}s/{name}"
        return Change(user(), None, method, route, subject, platform.node(), status)

    return of


def of_hub(_name: str) -> Change:
    """The same of the hub's own key."""
    return Change(user(), None, "POST", f"/{OF_HUB}", f"/{OF_HUB}", platform.node(), MADE)


def user() -> str:
    """Who calls this, as the system knows them."""
    try:
        return getpass.getuser()
    except (KeyError, OSError):  # nobody of the system's has this number
        return str(os.getuid())


def moment(after_s: int | None) -> int | None:
    """So many seconds from now, in milliseconds since 1970; None if there is no number."""
    return None if after_s is None else now_ms() + 1_000 * after_s


def file_of(arguments: argparse.Namespace) -> Path:
    """Where a new key is written."""
    return arguments.file or Path(f"{arguments.name}.key")


def create(folder: KeyFolder, arguments: argparse.Namespace) -> msgspec.Struct:
    """A new key, in a file."""
    return folder.create(arguments.name, file_of(arguments), moment(arguments.expires_s))


def listed(folder: KeyFolder, _arguments: argparse.Namespace) -> tuple[msgspec.Struct, ...]:
    """Who is let in, or was for a time."""
    return folder.list()


def rotate(folder: KeyFolder, arguments: argparse.Namespace) -> msgspec.Struct:
    """Another key of a name, in a file."""
    until_ms, keep_ms = moment(arguments.expires_s), moment(arguments.keep_s)
    return folder.rotate(arguments.name, file_of(arguments), until_ms, keep_ms or 0)


def rotate_hub(folder: KeyFolder, _arguments: argparse.Namespace) -> msgspec.Struct:
    """Another key of the hub."""
    return folder.rotate_hub()


def revoke(folder: KeyFolder, arguments: argparse.Namespace) -> msgspec.Struct:
    """A key that lets nobody in any more."""
    return folder.revoke(arguments.name)


class Action(NamedTuple):
    """What is done, and what the audit log tells of it, if it changes something.

    Attributes:
        keeps: a key that has the name already stays as it is.
    """

    run: Callable[[KeyFolder, argparse.Namespace], msgspec.Struct | tuple[msgspec.Struct, ...]]
    change: Callable[[str], Change] | None = None
    keeps: bool = False


ACTIONS: Mapping[str, Action] = {
    "create": Action(create, changing("POST", "", MADE), keeps=True),
    "list": Action(listed),
    "rotate": Action(rotate, changing("POST", "/{name}/rotations", MADE)),
    "rotate-hub": Action(rotate_hub, of_hub),
    "revoke": Action(revoke, changing("DELETE", "/{name}", DONE)),
}
