"""`python -m eigenfail_services worker-key …`: workers' keys in the hub's folder; prints JSON."""

import argparse
import os
import sys
from collections.abc import Callable, Mapping
from pathlib import Path

import msgspec

from eigenfail.errors import InvalidValue
from eigenfail.wire.curve import AllowedWorker
from eigenfail_services.hub.binding import KEYS_VARIABLE
from eigenfail_services.hub.keys import FIELD, KeyFolder, closed_to_us

Answer = AllowedWorker | tuple[AllowedWorker, ...]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """What the command line takes."""
    parser.add_argument("action", choices=ACTIONS)
    parser.add_argument("--name", default="", help="of a key")
    parser.add_argument("--file", type=Path, help="to which a new key is written")
    parser.add_argument(FIELD, type=Path, default=argparse.SUPPRESS, help="folder of its keys")
    parser.set_defaults(command=tend_keys)


def default_folder() -> Path | None:
    """The folder of keys that the environment names."""
    named = os.environ.get(KEYS_VARIABLE)
    return Path(named) if named else None


def tend_keys(arguments: argparse.Namespace) -> None:
    """Do what the command line says, and print the answer.

    Raises:
        InvalidValue: no folder is named, or what was asked for cannot be done.
    """
    if arguments.hub_keys is None:
        raise InvalidValue(FIELD, "is not given.", "Name the folder of the hub's keys.")
    try:
        found = ACTIONS[arguments.action](KeyFolder(arguments.hub_keys), arguments)
    except OSError as error:
        raise closed_to_us(arguments.hub_keys, error) from error
    sys.stdout.write(msgspec.json.encode(found).decode() + "\n")


def create(folder: KeyFolder, arguments: argparse.Namespace) -> AllowedWorker:
    """A new key, in a file."""
    return folder.create(arguments.name, arguments.file or Path(f"{arguments.name}.key"))


def listed(folder: KeyFolder, _arguments: argparse.Namespace) -> tuple[AllowedWorker, ...]:
    """Who is let in."""
    return folder.list()


def revoke(folder: KeyFolder, arguments: argparse.Namespace) -> AllowedWorker:
    """A key that lets nobody in any more."""
    return folder.revoke(arguments.name)


ACTIONS: Mapping[str, Callable[[KeyFolder, argparse.Namespace], Answer]] = {
    "create": create,
    "list": listed,
    "revoke": revoke,
}
