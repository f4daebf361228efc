"""`python -m eigenfail_services db …`: the database itself, for whoever can write it."""

import argparse
import sys
from collections.abc import Callable, Mapping
from pathlib import Path

import msgspec

from eigenfail.errors import InvalidValue
from eigenfail.values.retention import DRAWN_AGAIN, KEEP_EVERY, Retention
from eigenfail.wire.http import encode
from eigenfail_services.store import migrate, open_store
from eigenfail_services.upkeep.backup import backup, restore
from eigenfail_services.upkeep.pruning import Which, prune, rehearse
from eigenfail_services.upkeep.revisions import downgrade
from eigenfail_services.upkeep.vacuum import vacuum
from eigenfail_services.upkeep.verify import verify


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """What the command line takes."""
    parser.add_argument("action", choices=ACTIONS)
    parser.add_argument("--database", default=argparse.SUPPRESS, help="URL")
    parser.add_argument("--file", type=Path, help="the backup")
    parser.add_argument("--force", action="store_true", help="replace what is there")
    parser.add_argument("--replay", type=int, default=0, help="how many episodes to run again")
    parser.add_argument("--repair", action="store_true", help="mend what is safe to mend")
    parser.add_argument("--to", default="", help="the revision to go back to")
    parser.add_argument("--keep-every", type=int, default=KEEP_EVERY, help="which noise stays")
    parser.add_argument("--source", default=DRAWN_AGAIN, help="of the noise that goes")
    parser.add_argument("--older-than", type=float, default=0.0, help="days since the end")
    parser.add_argument("--campaign", type=int, action="append", default=[], help="only these")
    parser.set_defaults(command=tend_database)


def tend_database(arguments: argparse.Namespace) -> None:
    """Do what the command line says, and print the answer."""
    sys.stdout.write(ACTIONS[arguments.action](arguments) + "\n")


def current(arguments: argparse.Namespace) -> str:
    """The revision of the schema, in words."""
    return migrate.current(arguments.database) or "empty"


def check(arguments: argparse.Namespace) -> str:
    """The same, if it is this program's.

    Raises:
        SchemaMismatch: it is another's.
    """
    open_store(arguments.database, migrate=False).close()
    return current(arguments)


def upgrade(arguments: argparse.Namespace) -> str:
    """Make the schema, or bring it up to this program's; its revision."""
    migrate.upgrade(arguments.database)
    return current(arguments)


def verified(arguments: argparse.Namespace) -> str:
    """What is wrong, and what was mended, as JSON."""
    found = verify(arguments.database, arguments.replay, repair=arguments.repair)
    return encode(found).decode()


def saved(arguments: argparse.Namespace) -> str:
    """A new backup, as JSON."""
    return encode(backup(arguments.database, named(arguments), force=arguments.force)).decode()


def restored(arguments: argparse.Namespace) -> str:
    """The backup that was put in place, as JSON."""
    return encode(restore(arguments.database, named(arguments), force=arguments.force)).decode()


def downgraded(arguments: argparse.Namespace) -> str:
    """The older revision that the schema has now."""
    return downgrade(arguments.database, arguments.to, force=arguments.force)


def rehearsed(arguments: argparse.Namespace) -> str:
    """What a pruning would take away, as JSON."""
    return encode(rehearse(arguments.database, rule(arguments), which(arguments))).decode()


def pruned(arguments: argparse.Namespace) -> str:
    """What was taken away, as JSON."""
    return encode(prune(arguments.database, rule(arguments), which(arguments))).decode()


def rule(arguments: argparse.Namespace) -> Retention:
    """Which noise stays.

    Raises:
        InvalidValue: there is no such source, or all would stay.
    """
    asked = {"keep_every": arguments.keep_every, "source": arguments.source}
    try:
        return msgspec.convert(asked, Retention)
    except msgspec.ValidationError as error:
        raise InvalidValue("retention", f"{error}.") from None


def which(arguments: argparse.Namespace) -> Which:
    """Of which campaigns."""
    return Which(tuple(arguments.campaign), arguments.older_than)


def vacuumed(arguments: argparse.Namespace) -> str:
    """What a database was and is, as JSON."""
    return encode(vacuum(arguments.database)).decode()


def named(arguments: argparse.Namespace) -> Path:
    """The file of a backup.

    Raises:
        InvalidValue: none is named.
    """
    if arguments.file is None:
        raise InvalidValue("file", "No backup is named.", "Add --file FILE.")
    file: Path = arguments.file
    return file


ACTIONS: Mapping[str, Callable[[argparse.Namespace], str]] = {
    "upgrade": upgrade,
    "current": current,
    "check": check,
    "verify": verified,
    "backup": saved,
    "restore": restored,
    "downgrade": downgraded,
    "rehearse-prune": rehearsed,
    "prune": pruned,
    "vacuum": vacuumed,
}
