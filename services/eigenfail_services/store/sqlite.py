"""SQLite: one file, many readers, one writer at a time."""

import os
import sqlite3
import time
from contextlib import suppress
from pathlib import Path
from typing import Any

from sqlalchemy import URL, Connection, Engine, NullPool, create_engine, event

from eigenfail.errors import InvalidValue, StoreUnavailable
from eigenfail.private_files import FOLDER_MODE, OWNER_ONLY
from eigenfail_services.store.clock import LeaseClock, steady_ms
from eigenfail_services.store.distress import FolderLock
from eigenfail_services.store.refusals import upgrade_command

BUSY_S = 30.0
RETRY_S = 0.02
MAX_IDLE_WAL_BYTES = 64 * 1024 * 1024

PRAGMAS = (
    "journal_mode = WAL",
    "synchronous = FULL",
    f"journal_size_limit = {MAX_IDLE_WAL_BYTES}",
)
KEYS = "foreign_keys = ON"

PRIMARY = 0xFF
UNWRITABLE = frozenset({sqlite3.SQLITE_FULL, sqlite3.SQLITE_READONLY, sqlite3.SQLITE_IOERR})
UNREADABLE = frozenset({sqlite3.SQLITE_IOERR_READ, sqlite3.SQLITE_IOERR_SHORT_READ})

ARGUMENTS: dict[str, Any] = {"connect_args": {"timeout": BUSY_S}, "hide_parameters": True}


class Sqlite:
    """The database in a file; its folder is made if it is missing."""

    remedy = "Check that its folder exists, can be written and has room."
    secrets: tuple[str, ...] = ()

    def __init__(self, url: URL) -> None:
        if url.database in {None, "", ":memory:"}:
            raise InvalidValue(
                "database",
                "The address names no file.",
                "Write sqlite:///folder/file.db; memory:// keeps everything in this process.",
            )
        # Connections are opened later too, when the current folder may be another.
        path = Path(str(url.database)).absolute()
        self._url = url.set(drivername="sqlite+pysqlite", database=str(path))
        self._path = path
        self.label = self.address = f"sqlite:///{path}"

    def engine(self) -> Engine:
        """For everyday work."""
        return self._tuned(create_engine(self._url, **ARGUMENTS), KEYS)

    def schema_engine(self) -> Engine:
        """For migrations, which replace tables that others refer to."""
        engine = create_engine(self._url, poolclass=NullPool, **ARGUMENTS)
        return self._tuned(engine)

    def prepare(self) -> None:
        """Make the folder and the file, for their owner alone; what is there already stays."""
        self._path.parent.mkdir(FOLDER_MODE, parents=True, exist_ok=True)
        # Before SQLite does: it gives the files beside it the mode that this one has.
        with suppress(FileExistsError):
            os.close(os.open(self._path, os.O_CREAT | os.O_EXCL | os.O_WRONLY, OWNER_ONLY))

    def require(self) -> None:
        """Refuse a file that is not there."""
        if not self._path.exists():
            raise StoreUnavailable(
                f"There is no {self.label}.", f"Make it: {upgrade_command(self.address)}."
            )

    def lock_schema(self, connection: Connection) -> None:
        """A transaction that writes has the whole file to itself."""

    def refuses_writes(self, error: object) -> bool:
        """Whether there is no room, or the file or its disk takes no writes."""
        code: int = getattr(error, "sqlite_errorcode", 0)
        return code not in UNREADABLE and code & PRIMARY in UNWRITABLE

    def signal(self) -> FolderLock:
        """A lock on the folder."""
        return FolderLock(self._path.parent)

    def _tuned(self, engine: Engine, *pragmas: str) -> Engine:
        @event.listens_for(engine, "connect")
        def tune(connection: sqlite3.Connection, _record: Any) -> None:
            # Python's own BEGIN comes too late and is never IMMEDIATE: ours takes its place.
            connection.isolation_level = None
            for pragma in (*PRAGMAS, *pragmas):
                patiently(connection, f"PRAGMA {pragma}")
            # SQLite's own knows the letters of English alone.
            connection.create_function("lower", 1, lower, deterministic=True)
            connection.create_function(LeaseClock.name, 0, steady_ms)

        event.listen(engine, "begin", begin)
        return engine


def lower(text: str | None) -> str | None:
    """Text in small letters."""
    return None if text is None else text.lower()


def patiently(connection: sqlite3.Connection, statement: str) -> None:
    """Run a statement as soon as it can be: two that turn a new file to WAL do not wait by rule."""
    until_s = time.monotonic() + BUSY_S
    while True:
        try:
            connection.execute(statement)
        except sqlite3.OperationalError as error:
            if error.sqlite_errorcode != sqlite3.SQLITE_BUSY or time.monotonic() > until_s:
                raise
            time.sleep(RETRY_S)
        else:
            return


def begin(connection: Connection) -> None:
    """Writers take the lock at once: one that began as a reader could not wait for it later."""
    writes = connection.get_execution_options().get("writes", False)
    connection.exec_driver_sql("BEGIN IMMEDIATE" if writes else "BEGIN")
