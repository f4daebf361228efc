"""SQLite: in a file, with many readers and one writer at a time, or in memory."""

import os
import sqlite3
import time
from collections.abc import Callable
from contextlib import closing, suppress
from errno import EACCES
from functools import cache, partial
from pathlib import Path
from tempfile import mkstemp
from threading import Lock
from typing import Any, NamedTuple
from uuid import uuid4

import sqlalchemy as sa

from eigenfail.addresses import sqlite_path, sqlite_uri, sqlite_url
from eigenfail.errors import StoreDamaged, StoreUnavailable
from eigenfail.files import make_private_folder
from eigenfail_services.store.alarms import FolderLock, ProcessFlag
from eigenfail_services.store.clock import LeaseClock, steady_ms
from eigenfail_services.store.errors import format_upgrade_command
from eigenfail_services.store.schema import event_counter, metadata

SCHEMA_WAIT_S = 30.0
PROBE_WAIT_S = 1.0
RETRY_S = 0.02
MAX_IDLE_WAL_BYTES = 64 * 1024 * 1024

CHECKPOINT_PAGES = 8_000
"""Pages of the log after which they are copied to the database, that is 32 MB.

A commit of many results writes pages of eight indexes again and again; of those that the log holds
several times, only the last is copied.
"""

CACHE_KIB = 8 * 1024
"""Pages that a connection keeps in memory. With SQLite's own 2 MB, a transaction of a thousand
results writes pages to the log before its commit, and reads them again to change them."""

PRAGMAS = (
    "journal_mode = WAL",
    "synchronous = FULL",
    f"cache_size = -{CACHE_KIB}",
    f"wal_autocheckpoint = {CHECKPOINT_PAGES}",
    f"journal_size_limit = {MAX_IDLE_WAL_BYTES}",
)
KEYS = "foreign_keys = ON"

PRIMARY = 0xFF
UNWRITABLE = frozenset({sqlite3.SQLITE_FULL, sqlite3.SQLITE_READONLY, sqlite3.SQLITE_IOERR})
UNREADABLE = frozenset({sqlite3.SQLITE_IOERR_READ, sqlite3.SQLITE_IOERR_SHORT_READ})

IMMUTABLE = "ro&immutable=1"
"""Mode of a file that no program changes while it is open; its write-ahead log is left out."""

LONGEST_PATH = 504
"""SQLite's own limit of 512, without the ending of a log beside the file. [bytes]"""

SMALLEST_PAGE = 512
"""Least number of bytes that SQLite writes at a time."""

WAL_ENDING, SHM_ENDING = "-wal", "-shm"
OPENED = "files"
"""Key under which a connection keeps the files that it has opened."""

UNREACHABLE = (
    "Check that its folder exists, can be written and has room, and that the user of the service "
    "may read and write the file."
)
TOO_LONG = (
    "SQLite opens no file whose path has more than {longest} bytes; this one has {length}. "
    "Choose a folder with a shorter path."
)
LOCKED = (
    "Another program holds its lock: wait for it, or end it (`fuser -v FILE` names it); then the "
    "service goes on by itself."
)
DAMAGED = (
    "Stop the service; `eigenfail db verify` names the damage. Move the file away, with its -wal "
    "and -shm, and put a backup in its place: `eigenfail db restore BACKUP`."
)
BUSY = frozenset({sqlite3.SQLITE_BUSY, sqlite3.SQLITE_LOCKED})
DAMAGES = frozenset({sqlite3.SQLITE_CORRUPT, sqlite3.SQLITE_NOTADB})

Identity = tuple[int, int]


class OpenedFiles(NamedTuple):
    """The files that a connection has opened: device and inode of each, and the database's size.

    As long as the connection is open, no other program may remove or replace any of them, and
    only VACUUM may shorten the database.
    """

    database: Identity | None
    wal: Identity | None
    shm: Identity | None
    size: int


class _SqliteErrors:
    """The meaning of SQLite's error codes."""

    def refuses_writes(self, error: object) -> bool:
        """Return whether the disk is full, or the file or its disk is read-only."""
        code: int = getattr(error, "sqlite_errorcode", 0)
        return code not in UNREADABLE and code & PRIMARY in UNWRITABLE

    def remedy_of(self, error: object) -> str:
        """Return what a user can do: the file is locked, damaged or out of reach."""
        if self.is_damage(error):
            return DAMAGED
        return LOCKED if getattr(error, "sqlite_errorcode", 0) & PRIMARY in BUSY else UNREACHABLE

    def is_full(self, _error: object) -> bool:
        """Return False: a file has as many connections as are opened."""
        return False

    def is_damage(self, error: object) -> bool:
        """Return whether the file is not a database, or a page of it is missing or damaged."""
        code: int = getattr(error, "sqlite_errorcode", 0)
        return code & PRIMARY in DAMAGES or code == sqlite3.SQLITE_IOERR_SHORT_READ


class Sqlite(_SqliteErrors):
    """The database in a file; its folder is made if it is missing.

    A connection never creates the file: `prepare` does, once. A file that is moved, deleted or
    replaced while it is in use is noticed, as whatever is written to it would be lost.

    Args:
        url: URL of the database.
        wait_s: how long a statement waits for the lock of another program. [s]
    """

    secrets: tuple[str, ...] = ()

    def __init__(self, url: str, wait_s: float) -> None:
        # Connections are opened later too, when the current folder may be another.
        self._path = sqlite_path(url)
        self._wait_s = wait_s
        self._identity: Identity | None = None
        # SQLite recreates log and index when no process has them open, and not before.
        self._counting = Lock()
        self._open_connections = 0
        self._last_opened: OpenedFiles | None = None
        self.label = self.address = sqlite_url(self._path)

    def engine(self) -> sa.Engine:
        """Return the engine for everyday work."""
        return self._tuned(self._engine(self._wait_s), self._wait_s, KEYS)

    def schema_engine(self) -> sa.Engine:
        """Return the engine for migrations, which replace tables that others refer to."""
        return self._tuned(self._engine(SCHEMA_WAIT_S, poolclass=sa.NullPool), SCHEMA_WAIT_S)

    def remedy_of(self, error: object) -> str:
        """Return what a user can do, also about a path that is too long for SQLite."""
        length = len(os.fsencode(self._path.resolve()))
        is_closed = getattr(error, "sqlite_errorcode", 0) & PRIMARY == sqlite3.SQLITE_CANTOPEN
        if is_closed and length > LONGEST_PATH:
            return TOO_LONG.format(longest=LONGEST_PATH, length=length)
        return super().remedy_of(error)

    def prepare(self) -> None:
        """Make the folder and an empty database, for their owner alone, unless it exists.

        Raises:
            StoreUnavailable: the database is missing, but its write-ahead log is there.
        """
        if self._path.exists():
            if find_mode(self._path) != "rw":
                raise PermissionError(EACCES, f"{self._path.parent} may not be written")
            return
        make_private_folder(self._path.parent)
        wal = _beside(self._path, WAL_ENDING)
        if _size(wal):
            # SQLite would replay it into the new database, to which it does not belong.
            raise StoreUnavailable(
                f"The database {self._path} is missing, but its write-ahead log {wal} is there.",
                "Move the database back beside it. To begin a new one, move the log away.",
            )
        _create(self._path)

    def require(self) -> None:
        """Refuse a file that is not there."""
        if not self._path.exists():
            raise StoreUnavailable(
                f"There is no {self.label}.", f"Make it: {format_upgrade_command(self.address)}."
            )

    def lock_schema(self, connection: sa.Connection) -> None:
        """Do nothing: a writer has the whole file to itself."""

    def signal(self) -> FolderLock:
        """Return a lock on the folder."""
        return FolderLock(self._path.parent)

    def check(self, connection: sa.Connection) -> None:
        """Compare the files that a connection has open with the files at their paths.

        Raises:
            StoreUnavailable: one of them was moved, deleted or replaced, or lost its end.
        """
        opened: OpenedFiles = connection.info[OPENED]
        now = _look(self._path)
        self._refuse_exchange(now, opened)
        if now.size < opened.size and self._lacks_pages(now.size):
            raise StoreDamaged(
                f"The database {self.label} is damaged: it was truncated from {opened.size} to "
                f"{now.size} bytes.",
                DAMAGED,
            )
        connection.info[OPENED] = now

    def probe(self, _connection: sa.Connection) -> None:
        """Read pages of every table from the file, and take the lock of writers for a moment.

        A new connection is needed: others answer from the pages that they remember. Nothing is
        written.

        Raises:
            StoreUnavailable: a file was exchanged.
            PermissionError: the file may not be read or written.
            sqlite3.Error: a page cannot be read, or the lock is not free within a second.
        """
        # Asked by name: SQLite may take a file that it has open already, whatever its permissions.
        if not os.access(self._path, os.R_OK | os.W_OK, effective_ids=True):
            raise PermissionError(EACCES, f"{self._path} may no longer be read and written")
        with closing(self._connect(PROBE_WAIT_S)) as connection:
            connection.isolation_level = None
            for table in metadata.tables:
                # The last row: on the way to it, pages are read from the beginning to the end.
                connection.execute(f'SELECT max(rowid) FROM "{table}"').fetchone()  # noqa: S608 - names of ours
            connection.execute("BEGIN IMMEDIATE")
            connection.execute("ROLLBACK")

    def _engine(self, wait_s: float, **options: Any) -> sa.Engine:
        url = sa.URL.create("sqlite+pysqlite", database=str(self._path))
        connect = partial(self._connect, wait_s)
        return sa.create_engine(url, creator=connect, hide_parameters=True, **options)

    def _connect(self, wait_s: float) -> sqlite3.Connection:
        """Open the file, which must be the one that was opened first.

        Raises:
            StoreUnavailable: the file is empty, missing or another one.
            sqlite3.Error: SQLite cannot open it.
        """
        before = _look(self._path)
        if before.database is not None and before.size < SMALLEST_PAGE:
            # SQLite would take it for a new database, and remove the write-ahead log beside it.
            raise StoreDamaged(
                f"The file {self.label} is no database: it has {before.size} bytes; what it held "
                "is lost.",
                "Move it away, with its -wal and -shm. Put a backup in its place: "
                "`eigenfail db restore BACKUP`; without one, a new database is made at the next "
                "start.",
            )
        if self._open_connections and self._last_opened:
            self._refuse_exchange(before, self._last_opened)
        uri = sqlite_uri(self._path, find_mode(self._path))
        connection = sqlite3.connect(uri, uri=True, timeout=wait_s, check_same_thread=False)
        now = _look(self._path)
        # The file that was looked at before, and that was opened first, or the connection is none.
        if now.database is None or not now.database == before.database == (
            self._identity or now.database
        ):
            connection.close()
            raise self._exchanged("")
        self._identity = now.database
        return connection

    def _lacks_pages(self, size: int) -> bool:
        """Return whether the file is shorter than its header says; VACUUM changes both.

        SQLite reads the header: if this process opened and closed the file itself, all of its
        locks on the file would be gone. `immutable` leaves out the write-ahead log, which may
        hold pages that the file has not got yet.
        """
        uri = sqlite_uri(self._path, IMMUTABLE)
        try:
            with closing(sqlite3.connect(uri, uri=True)) as connection:
                connection.execute("PRAGMA page_count").fetchone()
        except sqlite3.DatabaseError:
            return True
        return size < SMALLEST_PAGE

    def _refuse_exchange(self, now: OpenedFiles, opened: OpenedFiles) -> None:
        """Raise StoreUnavailable unless database, write-ahead log and index are those opened."""
        for ending, here, there in zip(("", WAL_ENDING, SHM_ENDING), now, opened, strict=False):
            if here != there:
                raise self._exchanged(ending)

    def _exchanged(self, ending: str) -> StoreUnavailable:
        """Return the error for a file that is not the one that was opened."""
        return StoreUnavailable(
            f"{_beside(self._path, ending)} was moved, deleted or replaced while the database was "
            "in use: nothing is taken until it is back.",
            "Put it back, with the -wal and -shm beside it, and the service goes on. Otherwise "
            "stop the service with Ctrl-C or SIGTERM, never with kill -9: the last changes may be "
            "in the -wal alone. Put a backup in place of what was deleted, by `eigenfail db "
            "restore BACKUP`, and start the service again.",
        )

    def _tuned(self, engine: sa.Engine, wait_s: float, *pragmas: str) -> sa.Engine:
        @sa.event.listens_for(engine, "connect")
        def tune(connection: sqlite3.Connection, record: Any) -> None:
            prepare_connection(connection)
            for pragma in (*PRAGMAS, *pragmas):
                execute_patiently(connection, f"PRAGMA {pragma}", wait_s)
            # A database that has just been turned to WAL gets its log with the first reader.
            execute_patiently(connection, "SELECT count(*) FROM sqlite_master", wait_s)
            with self._counting:
                self._open_connections += 1
                record.info[OPENED] = self._last_opened = _look(self._path)

        @sa.event.listens_for(engine, "close")
        def forget(_connection: sqlite3.Connection, _record: Any) -> None:
            with self._counting:
                self._open_connections -= 1

        sa.event.listen(engine, "begin", _begin)
        return engine


class SqliteMemory(_SqliteErrors):
    """A database in memory, which is deleted when its engine is disposed of.

    All threads share it, each through its own connection. SQLite does not keep a write-ahead log in
    memory: a writer waits for earlier readers, and readers wait for a writer.

    Args:
        wait_s: how long a statement waits for a lock. [s]
        image: a database to begin with, as `image` returns it; if empty, a new one.
    """

    label = address = "memory://"
    secrets: tuple[str, ...] = ()

    def __init__(self, wait_s: float, image: bytes = b"") -> None:
        self._uri = f"file:/eigenfail-{uuid4().hex}?vfs=memdb"
        self._wait_s = wait_s
        self._signal = ProcessFlag()
        # SQLite forgets the database with the last of its connections; this one stays.
        self._first = self._connect()
        if image:
            with closing(sqlite3.connect(":memory:")) as source:
                source.deserialize(image)
                source.backup(self._first)

    def image(self) -> bytes:
        """Return the whole database as bytes."""
        return self._first.serialize()

    def engine(self) -> sa.Engine:
        """Return the engine for everyday work."""
        engine = self._engine(sa.QueuePool, KEYS)
        sa.event.listen(engine, "engine_disposed", lambda _engine: self._first.close())
        return engine

    def schema_engine(self) -> sa.Engine:
        """Return the engine for migrations, which replace tables that others refer to."""
        return self._engine(sa.NullPool)

    def prepare(self) -> None:
        """Do nothing: the database exists from the beginning."""

    def require(self) -> None:
        """Do nothing: the database exists from the beginning."""

    def lock_schema(self, connection: sa.Connection) -> None:
        """Do nothing: a writer has the whole database to itself."""

    def signal(self) -> ProcessFlag:
        """Return a flag: only this process uses the database."""
        return self._signal

    def check(self, connection: sa.Connection) -> None:
        """Do nothing: the database cannot be replaced."""

    def probe(self, connection: sa.Connection) -> None:
        """Read a row."""
        connection.execute(sa.select(event_counter.c.last)).scalar_one()

    def _engine(self, pool: Callable[..., sa.Pool], *pragmas: str) -> sa.Engine:
        dialect = _memory_dialect()
        engine = sa.Engine(
            pool(self._connect, dialect=dialect),
            dialect,
            sa.make_url("sqlite+pysqlite://"),
            hide_parameters=True,
            execution_options={"compiled_cache": _COMPILED},
        )

        @sa.event.listens_for(engine, "connect")
        def tune(connection: sqlite3.Connection, _record: Any) -> None:
            prepare_connection(connection)
            for pragma in pragmas:
                connection.execute(f"PRAGMA {pragma}")

        sa.event.listen(engine, "begin", _begin)
        return engine

    def _connect(self) -> sqlite3.Connection:
        return sqlite3.connect(self._uri, uri=True, timeout=self._wait_s, check_same_thread=False)


_COMPILED: dict[Any, Any] = {}


@cache
def _memory_dialect() -> sa.Dialect:
    """Return the dialect of all databases in memory.

    Compiled statements belong to a dialect. All databases in memory share one dialect, so each
    statement is compiled once for a process, and not once for each database.
    """
    engine = sa.create_engine("sqlite+pysqlite://", poolclass=sa.NullPool)
    engine.connect().close()  # fills in what depends on SQLite's version
    return engine.dialect


def _beside(path: Path, ending: str) -> Path:
    return path.with_name(path.name + ending)


def find_mode(path: Path) -> str:
    """Return the mode for opening a database, as in SQLite's URIs.

    SQLite creates a log and an index next to a database in WAL mode, even to read it. In a folder
    that cannot be written, such as a read-only share with a backup, a database without a log is
    opened as immutable.
    """
    is_writable = os.access(path.parent, os.W_OK, effective_ids=True)
    return "rw" if is_writable or _beside(path, WAL_ENDING).exists() else IMMUTABLE


def _size(path: Path) -> int:
    with suppress(FileNotFoundError):
        return path.stat().st_size
    return 0


def _look(path: Path) -> OpenedFiles:
    """Return the files at the paths of a database."""
    found: list[os.stat_result | None] = []
    for ending in ("", WAL_ENDING, SHM_ENDING):
        try:
            found.append(_beside(path, ending).stat())
        except (FileNotFoundError, NotADirectoryError):
            found.append(None)
    database, wal, shm = (None if one is None else (one.st_dev, one.st_ino) for one in found)
    return OpenedFiles(database, wal, shm, found[0].st_size if found[0] else 0)


def _create(path: Path) -> None:
    """Make an empty database; if another process makes it at the same time, that one stays.

    It is complete before it has its name: a file of 0 bytes under that name is never a new one.
    """
    handle, name = mkstemp(".new", f".{path.name}.", path.parent)
    os.close(handle)
    draft = Path(name)
    try:
        with closing(sqlite3.connect(draft)) as connection:
            # Writes the first page; beside it, SQLite gives files the mode that this one has.
            connection.execute("PRAGMA journal_mode = WAL")
        try:
            os.link(draft, path)
        except FileExistsError:
            return
        except OSError:  # a file system without hard links
            if not path.exists():
                draft.rename(path)
    finally:
        draft.unlink(missing_ok=True)


def prepare_connection(connection: sqlite3.Connection) -> None:
    """Set up a connection, to a file or to memory."""
    # Python's own BEGIN comes too late and is never IMMEDIATE: ours takes its place.
    connection.isolation_level = None
    # SQLite's own knows the letters of English alone.
    connection.create_function("lower", 1, _lower, deterministic=True)
    connection.create_function(LeaseClock.name, 0, steady_ms)


def _lower(text: str | None) -> str | None:
    return None if text is None else text.lower()


def execute_patiently(connection: sqlite3.Connection, statement: str, wait_s: float) -> None:
    """Execute a statement, and try again while the file is busy.

    Two programs that turn a new file to WAL do not wait for each other by SQLite's own rules.
    """
    until_s = time.monotonic() + wait_s
    while True:
        try:
            connection.execute(statement)
        except sqlite3.OperationalError as error:
            if error.sqlite_errorcode != sqlite3.SQLITE_BUSY or time.monotonic() > until_s:
                raise
            time.sleep(RETRY_S)
        else:
            return


def _begin(connection: sa.Connection) -> None:
    """Take the writers' lock at once: a transaction that began as a reader cannot wait for it."""
    writes = connection.get_execution_options().get("writes", False)
    connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN")
