"""Free room inside a database, given back."""

import os
import sqlite3
from collections.abc import Callable, Mapping
from contextlib import closing, suppress
from pathlib import Path
from shutil import disk_usage
from typing import Protocol

from sqlalchemy import URL, Connection, func, inspect, make_url, select, text

from eigenfail.errors import ServiceError
from eigenfail.values.retention import Vacuumed
from eigenfail_services.store import open_store
from eigenfail_services.store.engine import find, translated
from eigenfail_services.store.schema import metadata
from eigenfail_services.upkeep.sqlite_files import BESIDE, WAIT_S, troubles

TEMPORARY = ("SQLITE_TMPDIR", "TMPDIR")
PLACES = ("/var/tmp", "/usr/tmp", "/tmp")  # noqa: S108 - where SQLite writes, in its order


class Sweeper(Protocol):
    """What differs between kinds of databases."""

    def size(self) -> int:
        """What it takes on the disk. [bytes]"""

    def sweep(self) -> None:
        """Give back what is free.

        Raises:
            ServiceError: somebody uses it, or there is no room to work in.
        """


def vacuum(address: str) -> Vacuumed:
    """Give back what rows that are gone have left.

    SQLite writes all that is there into a new file: nobody else may use the database meanwhile,
    and there must be room for both. PostgreSQL works beside a service: room at the end of its
    files is given back, room between rows is used again.

    Raises:
        InvalidValue: the address is none.
        StoreUnavailable: there is no database, or it does not answer.
        SchemaMismatch: its schema is another.
        ServiceError: somebody uses it, or there is no room to work in.
    """
    open_store(address, migrate=False).close()
    url = make_url(address)
    sweeper = SWEEPERS[url.get_backend_name()](url)
    before = sweeper.size()
    sweeper.sweep()
    return Vacuumed(find(address).label, before, sweeper.size())


class SqliteSweeper:
    """One database file."""

    def __init__(self, url: URL) -> None:
        self._path = Path(str(url.database)).absolute()

    def size(self) -> int:
        """Of the file and those beside it."""
        sizes = 0
        for ending in BESIDE:
            with suppress(FileNotFoundError):
                sizes += self._path.with_name(self._path.name + ending).stat().st_size
        return sizes

    def sweep(self) -> None:
        """Write it anew, with nobody else there: whoever writes would wait in vain for minutes."""
        with (
            troubles(f"{self._path} was left as it is"),
            closing(sqlite3.connect(self._path, timeout=WAIT_S)) as connection,
        ):
            # Refused unless nobody else has it open.
            connection.execute("PRAGMA journal_mode = DELETE")
            refuse_narrowness(self._path, connection)
            connection.execute("VACUUM")
            connection.execute("PRAGMA journal_mode = WAL")


def refuse_narrowness(path: Path, connection: sqlite3.Connection) -> None:
    """Raises ServiceError where there is no room for a second copy, and for the way back."""
    asked = ("page_count", "freelist_count", "page_size")
    pages, free, each = (connection.execute(f"PRAGMA {name}").fetchone()[0] for name in asked)
    copy, journal = (pages - free) * each, pages * each
    scratch = temporary_folder()
    for folder, needed in needs(scratch, copy, path.parent, journal).items():
        if (there := disk_usage(folder).free) < needed:
            raise ServiceError(
                f"{path} needs {needed} bytes in {folder} to be written anew, and there are "
                f"{there}.",
                "Make room, or let SQLITE_TMPDIR name a folder on another disk.",
            )


def needs(scratch: Path, copy: int, home: Path, journal: int) -> Mapping[Path, int]:
    """What is needed where; on one disk both."""
    if scratch.stat().st_dev == home.stat().st_dev:
        return {home: copy + journal}
    return {scratch: copy, home: journal}


def temporary_folder() -> Path:
    """Where SQLite writes the copy: the first of its places that is a folder one may write in."""
    named = (os.environ.get(name) for name in TEMPORARY)
    for place in map(Path, (*filter(None, named), *PLACES)):
        if place.is_dir() and os.access(place, os.W_OK | os.X_OK):
            return place
    return Path()


class PostgresSweeper:
    """One database at a server."""

    def __init__(self, url: URL) -> None:
        self._backend = find(url.render_as_string(hide_password=False))
        engine = self._backend.schema_engine()
        self._engine = engine.execution_options(isolation_level="AUTOCOMMIT")

    def size(self) -> int:
        """Of its tables and their indexes."""
        with translated(self._backend), self._engine.connect() as connection:
            return sum(size_of(connection, name) for name in ours(connection))

    def sweep(self) -> None:
        """Table by table, and count anew what the planner of questions goes by."""
        with translated(self._backend), self._engine.connect() as connection:
            for name in ours(connection):
                connection.execute(text(f'VACUUM (ANALYZE) "{name}"'))


def ours(connection: Connection) -> list[str]:
    """Names of our tables that are there."""
    return sorted(set(metadata.tables) & set(inspect(connection).get_table_names()))


def size_of(connection: Connection, table: str) -> int:
    """With its indexes, and what is stored beside its rows. [bytes]"""
    size: int = connection.execute(select(func.pg_total_relation_size(table))).scalar_one()
    return size


SWEEPERS: Mapping[str, Callable[[URL], Sweeper]] = {
    "sqlite": SqliteSweeper,
    "postgresql": PostgresSweeper,
    "postgres": PostgresSweeper,
}
