"""Backups of SQLite: a file that is itself a database, made by SQLite's own online backup."""

import sqlite3
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path
from urllib.parse import quote

from sqlalchemy import URL, column, select, table

from eigenfail.errors import Conflict, ServiceError
from eigenfail_services.store.schema import VERSION_TABLE, metadata
from eigenfail_services.upkeep.refusals import HAS_ROWS, no_backup, not_empty

REVISION = str(select(column("version_num")).select_from(table(VERSION_TABLE)))

WAIT_S = 1.0
"""For others to let go of the database before it is said that they use it."""

BESIDE = ("", "-wal", "-shm", "-journal")
"""Endings of the names of the database's files, some of which are there only while it is open."""

TABLES = "SELECT name FROM sqlite_master WHERE type = 'table' AND substr(name, 1, 7) <> 'sqlite_'"


class SqliteFiles:
    """One database file."""

    def __init__(self, url: URL) -> None:
        self._path = Path(str(url.database)).absolute()

    def holds(self, file: Path) -> bool:
        """Whether it is the database, or one of those that SQLite keeps beside it."""
        path = self._path.resolve()
        return any(same(file, path.with_name(path.name + ending)) for ending in BESIDE)

    def save(self, draft: Path) -> None:
        """Copy all pages as of one moment; whoever writes meanwhile writes to the log beside."""
        with (
            troubles(f"The backup of {self._path} failed"),
            closing(opened(self._path, "rw")) as source,
            closing(sqlite3.connect(draft)) as target,
        ):
            source.backup(target)
            # In one file, that can be read where nothing can be written.
            target.execute("PRAGMA journal_mode = DELETE")

    def revision(self, file: Path) -> str:
        """The revision in a file of which every page is in order."""
        try:
            with closing(opened(file, "ro")) as source:
                refuse_damage(source)
                (found,) = source.execute(REVISION).fetchone()
                return str(found)
        except (sqlite3.Error, TypeError) as error:
            raise no_backup(file, str(error)) from error

    def load(self, file: Path, *, force: bool) -> None:
        """Write all pages in one transaction of SQLite's."""
        with (
            troubles(f"{self._path} was left as it is"),
            closing(opened(file, "ro")) as source,
            closing(sqlite3.connect(self._path, timeout=WAIT_S)) as target,
        ):
            # Refused unless nobody else has it open.
            target.execute("PRAGMA journal_mode = DELETE")
            refuse_strangers(self._path, target)
            if not force:
                refuse_content(self._path, target)
            source.backup(target)
            refuse_damage(target)


def same(one: Path, other: Path) -> bool:
    """Whether two paths lead to one file, or would if it were there."""
    if one.exists() and other.exists():
        return one.samefile(other)
    return one.resolve() == other.resolve()


def opened(path: Path, mode: str) -> sqlite3.Connection:
    """A connection to a file that is there."""
    return sqlite3.connect(f"file:{quote(str(path.absolute()))}?mode={mode}", uri=True)


def refuse_damage(connection: sqlite3.Connection) -> None:
    """Raises sqlite3.Error where a page is not in order."""
    (found,) = connection.execute("PRAGMA quick_check(1)").fetchone()
    if found != "ok":
        raise sqlite3.DatabaseError(found)


def refuse_strangers(path: Path, connection: sqlite3.Connection) -> None:
    """Raises Conflict where the database holds what is not eigenfail's: it would be lost."""
    names = {name for (name,) in connection.execute(TABLES)}
    if strange := sorted(names - {*metadata.tables, VERSION_TABLE}):
        raise Conflict(
            f"{path} has tables that are not eigenfail's: {', '.join(strange)}.",
            "Restore into a database of its own.",
        )


def refuse_content(path: Path, connection: sqlite3.Connection) -> None:
    """Raises Conflict where a table has a row."""
    names = HAS_ROWS.keys() & {name for (name,) in connection.execute(TABLES)}
    if any(connection.execute(HAS_ROWS[name]).fetchone()[0] for name in names):
        raise not_empty(str(path))


@contextmanager
def troubles(what: str) -> Iterator[None]:
    """Let SQLite's troubles out as ServiceError.

    Raises:
        ServiceError: somebody else uses the database, it is damaged, or there is no room.
    """
    remedies = {
        sqlite3.SQLITE_BUSY: "Stop the service that uses it, and whatever else has it open.",
        sqlite3.SQLITE_FULL: "Make room on the disk, and try again.",
        sqlite3.SQLITE_NOTADB: "Move the damaged file away, with its -wal and -shm, and try again.",
    }
    try:
        yield
    except sqlite3.Error as error:
        code = getattr(error, "sqlite_errorcode", 0)
        remedy = remedies.get(code, "Check that the folder can be written and has room.")
        raise ServiceError(f"{what}: {error}.", remedy) from error
