"""`python -m eigenfail_services key …`: keys on the database itself, for whoever can write it.

It prints JSON. Who asks is not asked for a key: the first one is made here.
"""

import argparse
import sys
from collections.abc import Callable, Mapping
from pathlib import Path

import msgspec

from eigenfail.contracts import Store
from eigenfail.errors import InvalidValue
from eigenfail.values.access import AuditEntry, Change, KeyRequest, NewKey
from eigenfail.values.quotas import Quotas
from eigenfail.wire.http import PREFIX, encode, read_fields
from eigenfail_services.access.first_key import FirstKey, first_key
from eigenfail_services.access.keys import make_key, revoke_key
from eigenfail_services.store import open_store

MOST = 1_000
CREATED, DONE = 201, 200
QUOTAS = Quotas.__struct_fields__


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """What the command line takes."""
    parser.add_argument("action", choices=ACTIONS)
    parser.add_argument("--name", help="of a new key")
    parser.add_argument("--file", type=Path, help="where `first` writes the key to")
    parser.add_argument("--scope", help="of a new key")
    parser.add_argument("--expires-s", type=int, help="how long a new key is valid")
    parser.add_argument("--key", type=int, help="id of the key to show, limit or revoke")
    for name in QUOTAS:
        parser.add_argument(f"--{name.replace('_', '-')}", type=int, help="a quota of the key")
    parser.add_argument("--database", default=argparse.SUPPRESS, help="URL")
    parser.set_defaults(command=tend_keys)


def tend_keys(arguments: argparse.Namespace) -> None:
    """Do what the command line says, and print the answer."""
    store = open_store(arguments.database, migrate=False)
    try:
        found = ACTIONS[arguments.action](store, arguments)
    finally:
        store.close()
    sys.stdout.write(encode(found).decode() + "\n")


def create(store: Store, arguments: argparse.Namespace) -> NewKey:
    """A new key."""
    given = {name: getattr(arguments, name) for name in ("name", "scope", "expires_s")}
    made = make_key(store, read_fields(given | {"quotas": quotas(arguments)}, KeyRequest))
    note(store, "POST", "", made.key.id, CREATED)
    return made


def first(store: Store, arguments: argparse.Namespace) -> FirstKey:
    """An administrator's key, in a file, unless there is one.

    Raises:
        InvalidValue: no file or no name is given, or it cannot be written.
    """
    if arguments.file is None or not arguments.name:
        raise InvalidValue("--file", "a file for the key, and its name, are needed.", "Give both.")
    told = first_key(store, arguments.name, arguments.file)
    if told.made is not None:
        note(store, "POST", "", told.made.id, CREATED)
    return told


def listed(store: Store, _arguments: argparse.Namespace) -> msgspec.Struct:
    """The newest keys."""
    return store.keys.page(MOST)


def shown(store: Store, arguments: argparse.Namespace) -> msgspec.Struct:
    """A key."""
    return store.keys.find(arguments.key).key


def limit(store: Store, arguments: argparse.Namespace) -> msgspec.Struct:
    """A key with these quotas, and no others, from now on."""
    limited = store.keys.limit(arguments.key, read_fields(quotas(arguments), Quotas))
    note(store, "POST", "/{key}/quotas", limited.id, DONE)
    return limited


def quotas(arguments: argparse.Namespace) -> dict[str, int | None]:
    """What the command line says of quotas."""
    return {name: getattr(arguments, name) for name in QUOTAS}


def revoke(store: Store, arguments: argparse.Namespace) -> msgspec.Struct:
    """A key that opens nothing any more."""
    revoked = revoke_key(store, arguments.key)
    note(store, "DELETE", "/{key}", revoked.id, DONE)
    return revoked


def changes(store: Store, _arguments: argparse.Namespace) -> msgspec.Struct:
    """The newest lines of the audit log."""
    return store.audit.page(MOST)


def note(store: Store, method: str, varying: str, key: int, status: int) -> AuditEntry:
    """A line of the audit log, as the API would have written it."""
    route = f"{PREFIX}/keys"
    told = Change("database", None, method, f"{route}{varying}", f"{route}/{key}", "", status)
    return store.audit.append(told)


ACTIONS: Mapping[str, Callable[[Store, argparse.Namespace], msgspec.Struct]] = {
    "create": create,
    "first": first,
    "list": listed,
    "show": shown,
    "limit": limit,
    "revoke": revoke,
    "audit": changes,
}
