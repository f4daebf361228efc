"""Backups: a whole database in one file, and its restoration, all or nothing.

A backup of SQLite is itself a database, made by SQLite's online backup. Those of PostgreSQL are
made and read by its own programs, pg_dump and pg_restore.
"""

import os
import re
import shlex
import sqlite3
import subprocess
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from pathlib import Path
from typing import Protocol

from sqlalchemy import (
    Connection,
    column,
    exists,
    inspect,
    literal_column,
    make_url,
    select,
    table,
    text,
)

from eigenfail.addresses import sqlite_path, sqlite_uri
from eigenfail.errors import Conflict, InvalidValue, ServiceError
from eigenfail.values.operations import Backup
from eigenfail_services.store.engine import Database, find_backend, read_kind
from eigenfail_services.store.migrate import find_version, refuse_unknown
from eigenfail_services.store.schema import VERSION_TABLE, event_counter, metadata
from eigenfail_services.store.sqlite import find_mode

HAS_ROWS: Mapping[str, str] = {
    table.name: str(select(exists(select(literal_column("1")).select_from(table))))
    for table in metadata.sorted_tables
    if table is not event_counter
}
"""SQL that checks whether a table has a row, for all tables that are empty in a new database."""


def _explain_no_backup(file: Path, why: str) -> InvalidValue:
    """Return the error for a file that is not a backup."""
    remedy = "Specify a file created by `eigenfail db backup` from the same type of database."
    return InvalidValue("file", f"'{file}' is not an eigenfail backup: {why}.", remedy)


def _explain_not_empty(database: str) -> Conflict:
    """Return the error for a database whose contents would be lost."""
    return Conflict(
        f"{database} is not empty.",
        "Restore into another one, or add --force: the contents of this one are then lost.",
    )


DUMPED_REVISION = re.compile(
    rf"^COPY [^\n]*{VERSION_TABLE}[^\n]* FROM stdin;\n(\S+)\n\\\.", re.MULTILINE
)
PLAIN = ("--no-owner", "--no-privileges")
# Most of a dump is noise in hexadecimal digits, which does not get smaller by more effort.
COMPRESSION = "--compress=1"
SCRIPT = ("--clean", "--if-exists", "--file=-")
STRICT = ("--no-psqlrc", "--quiet", "--set=ON_ERROR_STOP=1")

TABLE_LIST = ", ".join(f'"{name}"' for name in (*metadata.tables, VERSION_TABLE))
# Not only the backup's tables are dropped: younger ones refer to them, and would be in the way of
# the migrations that create them.
DROP_TABLES = f"BEGIN; SET LOCAL client_min_messages = warning; DROP TABLE IF EXISTS {TABLE_LIST}"

UNCHANGED_REMEDY = (
    "The database was not changed. Check the rights of its user, and the room on its disk."
)

COUNT_CONNECTIONS = text(
    "SELECT count(*) FROM pg_stat_activity WHERE datname = current_database() "
    "AND application_name = 'eigenfail' AND pid <> pg_backend_pid()"
)


class PostgresDumps:
    """Backups of a PostgreSQL database."""

    def __init__(self, address: str) -> None:
        self._backend, url = find_backend(address), make_url(address)
        secret = url.password or url.query.get("password")
        # In the environment, as all users of the machine can read a program's arguments.
        self._environment = os.environ | ({"PGPASSWORD": str(secret)} if secret else {})

    def holds(self, _file: Path) -> bool:
        """Return False: the database's files are the server's."""
        return False

    def save(self, draft: Path) -> None:
        """Write a dump; pg_dump reads it in one transaction."""
        self._run(
            "pg_dump", "--format=custom", COMPRESSION, *PLAIN, f"--file={draft}", self._target()
        )

    def revision(self, file: Path) -> str:
        """Return the schema's revision in a dump."""
        words = ("--data-only", f"--table={VERSION_TABLE}", "--file=-", str(file))
        try:
            said = self._run("pg_restore", *words)
        except ServiceError as error:
            raise _explain_no_backup(file, error.problem.rstrip(".")) from error
        if found := DUMPED_REVISION.search(said):
            return found[1]
        raise _explain_no_backup(file, "it has no table of eigenfail's schema")

    def load(self, file: Path, *, force: bool) -> None:
        """Restore a dump in one transaction."""
        with closing(Database(self._backend)) as database, database.reading() as connection:
            self._refuse(connection, force)
        self._replace(("pg_restore", *SCRIPT, *PLAIN, str(file)))

    def _target(self) -> str:
        return f"--dbname={self._backend.address}"

    def _refuse(self, connection: Connection, force: bool) -> None:
        label = self._backend.label
        if connection.execute(COUNT_CONNECTIONS).scalar_one():
            raise ServiceError(f"A service uses {label}.", "Stop it, and try again.")
        # A newer schema has tables that this program does not know.
        refuse_unknown(find_version(connection), label)
        names = HAS_ROWS.keys() & inspect(connection).get_table_names()
        for name in () if force else names:
            if connection.exec_driver_sql(HAS_ROWS[name]).scalar_one():
                raise _explain_not_empty(label)

    def _replace(self, reader: Sequence[str]) -> None:
        """Drop eigenfail's tables and run the script that a program writes: all of it, or nothing.

        Raises:
            ServiceError: a program is not installed, or fails.
        """
        writer = ("psql", *STRICT, f"--command={DROP_TABLES}", "--file=-", self._target())
        with _require_program(writer[0]), self._psql(writer) as psql:
            read = subprocess.run(
                reader, stdout=psql.stdin, stderr=subprocess.PIPE, text=True, check=False
            )
            # Without a COMMIT, psql ends and the server rolls everything back.
            _, complaint = psql.communicate("" if read.returncode else "COMMIT;\n")
        if psql.returncode:
            raise _explain_failure("psql", complaint, UNCHANGED_REMEDY)
        if read.returncode:
            raise _explain_failure(reader[0], read.stderr, UNCHANGED_REMEDY)

    def _psql(self, words: Sequence[str]) -> "subprocess.Popen[str]":
        return subprocess.Popen(
            words,
            stdin=subprocess.PIPE,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            text=True,
            env=self._environment,
        )

    def _run(self, *words: str) -> str:
        """Run a program of PostgreSQL and return its output.

        Raises:
            ServiceError: it is not installed, or fails.
        """
        command = f"Run: {shlex.join(words)}"
        with _require_program(words[0], command):
            done = subprocess.run(
                words, capture_output=True, text=True, check=False, env=self._environment
            )
        if done.returncode:
            raise _explain_failure(words[0], done.stderr, command)
        return done.stdout


@contextmanager
def _require_program(program: str, instead: str = "") -> Iterator[None]:
    """Raise ServiceError if a program is missing; `instead` is what to run elsewhere."""
    try:
        yield
    except FileNotFoundError:
        remedy = f"Install PostgreSQL's client programs, or do it where they are. {instead}"
        raise ServiceError(f"{program} is not installed here.", remedy.strip()) from None


def _explain_failure(program: str, said: str, remedy: str) -> ServiceError:
    """Return the error for a failed program, with its messages in one line."""
    complaint = "; ".join(said.strip().splitlines()).rstrip(".") or "it says nothing"
    return ServiceError(f"{program} failed: {complaint}.", remedy)


SELECT_REVISION = str(select(column("version_num")).select_from(table(VERSION_TABLE)))

LOCK_TIMEOUT_S = 1.0
"""Time for other programs to release the database before it counts as in use."""

FILE_SUFFIXES = ("", "-wal", "-shm", "-journal")
"""Endings of the names of a database's files; some exist only while it is open."""

SELECT_TABLES = (
    "SELECT name FROM sqlite_master WHERE type = 'table' AND substr(name, 1, 7) <> 'sqlite_'"
)


class SqliteBackups:
    """Backups of a SQLite database."""

    def __init__(self, address: str) -> None:
        self._path = sqlite_path(address)

    def holds(self, file: Path) -> bool:
        """Return whether a path leads to the database file or a companion file of SQLite."""
        path = self._path.resolve()
        return any(
            _is_same_file(file, path.with_name(path.name + ending)) for ending in FILE_SUFFIXES
        )

    def save(self, draft: Path) -> None:
        """Copy all pages as of one moment; meanwhile others write to the write-ahead log."""
        with (
            translate_sqlite_errors(f"The backup of {self._path} failed"),
            closing(open_sqlite(self._path, find_mode(self._path))) as source,
            closing(open_sqlite(draft, "rw")) as target,
        ):
            source.backup(target)
            # A single file without a log can be read where nothing can be written.
            target.execute("PRAGMA journal_mode = DELETE")

    def revision(self, file: Path) -> str:
        """Return the schema's revision in an undamaged file."""
        try:
            with closing(open_backup(file)) as source:
                _refuse_damage(source)
                (found,) = source.execute(SELECT_REVISION).fetchone()
                return str(found)
        except (sqlite3.Error, TypeError) as error:
            raise _explain_no_backup(file, str(error)) from error

    def load(self, file: Path, *, force: bool) -> None:
        """Write all pages in one transaction."""
        with (
            translate_sqlite_errors(f"{self._path} was not changed"),
            closing(open_backup(file)) as source,
            closing(open_sqlite(self._path, "rw", LOCK_TIMEOUT_S)) as target,
        ):
            # SQLite refuses to change the mode of a database that another program has open.
            target.execute("PRAGMA journal_mode = DELETE")
            _refuse_foreign_tables(self._path, target)
            if not force:
                _refuse_rows(self._path, target)
            source.backup(target)
            _refuse_damage(target)


def _is_same_file(one: Path, other: Path) -> bool:
    """Return whether two paths lead to the same file, whether or not it exists."""
    if one.exists() and other.exists():
        return one.samefile(other)
    return one.resolve() == other.resolve()


def open_sqlite(path: Path, mode: str, wait_s: float = 5.0) -> sqlite3.Connection:
    """Return a connection to an existing file.

    Args:
        path: path of the file.
        mode: as in SQLite's URIs: `ro`, `rw`, or what `find_mode` returns.
        wait_s: how long it waits for the locks of others. [s]
    """
    return sqlite3.connect(sqlite_uri(path, mode), uri=True, timeout=wait_s)


def open_backup(file: Path) -> sqlite3.Connection:
    """Return a connection that only reads a file, which may be on a read-only medium."""
    mode = find_mode(file)
    return open_sqlite(file, "ro" if mode == "rw" else mode)


def _refuse_damage(connection: sqlite3.Connection) -> None:
    """Raise sqlite3.Error if a page is damaged."""
    (found,) = connection.execute("PRAGMA quick_check(1)").fetchone()
    if found != "ok":
        raise sqlite3.DatabaseError(found)


def _refuse_foreign_tables(path: Path, connection: sqlite3.Connection) -> None:
    """Raise Conflict if the database holds tables of other programs, which would be lost."""
    names = {name for (name,) in connection.execute(SELECT_TABLES)}
    if strange := sorted(names - {*metadata.tables, VERSION_TABLE}):
        raise Conflict(
            f"{path} has tables that are not eigenfail's: {', '.join(strange)}.",
            "Restore into a database of its own.",
        )


def _refuse_rows(path: Path, connection: sqlite3.Connection) -> None:
    """Raise Conflict if a table has a row."""
    names = HAS_ROWS.keys() & {name for (name,) in connection.execute(SELECT_TABLES)}
    if any(connection.execute(HAS_ROWS[name]).fetchone()[0] for name in names):
        raise _explain_not_empty(str(path))


@contextmanager
def translate_sqlite_errors(what: str) -> Iterator[None]:
    """Translate SQLite's errors into ServiceError.

    Args:
        what: failed, as a sentence without its end.

    Raises:
        ServiceError: another program uses the database, it is damaged, or the disk is full.
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


DRAFT_SUFFIX = ".part"


class BackupProgram(Protocol):
    """Backup and restoration of one kind of database."""

    def holds(self, file: Path) -> bool:
        """Return whether a path leads to one of the database's own files."""

    def save(self, draft: Path) -> None:
        """Write the whole database, as of one moment, to a file while others may write.

        Raises:
            ServiceError: the database cannot be read, or the file not written.
        """

    def revision(self, file: Path) -> str:
        """Return the schema's revision in a complete backup.

        Raises:
            InvalidValue: the file is not a complete backup.
        """

    def load(self, file: Path, *, force: bool) -> None:
        """Replace the contents of the database by a backup: all of it or nothing.

        Raises:
            Conflict: the database is not empty, and `force` is not set.
            ServiceError: the database is in use, or cannot be written.
        """


PROGRAMS: Mapping[str, Callable[[str], BackupProgram]] = {
    "sqlite": SqliteBackups,
    "postgresql": PostgresDumps,
    "postgres": PostgresDumps,
}


def find_program(address: str) -> BackupProgram:
    """Return the backup program for the database at an address that `find` has checked."""
    return PROGRAMS[read_kind(address)](address)


def backup(address: str, file: Path, *, force: bool = False) -> Backup:
    """Write a backup; the file has its name only once it is complete, checked and on the disk.

    Args:
        address: address of the database; a service may use it meanwhile.
        file: file to write; its folder must exist.
        force: whether it may replace another file.

    Raises:
        InvalidValue: the address is invalid.
        Conflict: the file exists, or belongs to the database.
        ServiceError: the database cannot be read, or the file not written.
    """
    backend = find_backend(address)
    backend.require()
    keeper = find_program(address)
    _refuse_existing(file, keeper, force)
    with _open_draft(file) as draft:
        keeper.save(draft)
        revision, size = keeper.revision(draft), draft.stat().st_size
        _sync(draft)
        _refuse_existing(file, keeper, force)
        draft.replace(file)
        _sync(file.parent)
    return Backup(backend.label, str(file), size, revision)


def restore(address: str, file: Path, *, force: bool = False) -> Backup:
    """Replace the contents of a database by a backup: all of it, or nothing is changed.

    Args:
        address: address of the database, which must not be in use meanwhile.
        file: a backup.
        force: whether the contents of the database may be lost.

    Raises:
        InvalidValue: the address is invalid, or the file is not a backup.
        Conflict: the database is not empty.
        SchemaMismatch: the backup is of a newer program.
        ServiceError: the database is in use, or cannot be written.
    """
    if file.exists() and not file.is_file():
        # The programs that read backups would wait for the end of a pipe or a device.
        raise _explain_no_backup(file, "it is not a regular file.")
    backend, keeper = find_backend(address), find_program(address)
    revision = keeper.revision(file)
    refuse_unknown(revision, str(file))
    backend.prepare()
    keeper.load(file, force=force)
    return Backup(backend.label, str(file), file.stat().st_size, revision)


def _refuse_existing(file: Path, keeper: BackupProgram, force: bool) -> None:
    """Raise Conflict if a file must not be overwritten, as the database's own never may."""
    if keeper.holds(file):
        raise Conflict(f"{file} is the database itself.", "Name another file.")
    if file.exists() and not force:
        raise Conflict(f"{file} exists already.", "Name another file, or add --force.")


@contextmanager
def _open_draft(file: Path) -> Iterator[Path]:
    """Yield a private file in the same folder, which is deleted after the block unless renamed."""
    with _translate_os_errors(file):
        handle, name = tempfile.mkstemp(DRAFT_SUFFIX, f".{file.name}.", file.parent)
        os.close(handle)
        draft = Path(name)
        try:
            yield draft
        finally:
            draft.unlink(missing_ok=True)


@contextmanager
def _translate_os_errors(file: Path) -> Iterator[None]:
    """Translate errors of the operating system into ServiceError."""
    try:
        yield
    except OSError as error:
        raise ServiceError(
            f"The backup {file} cannot be written: {error.strerror}.",
            "Check that its folder exists, can be written and has room.",
        ) from error


def _sync(path: Path) -> None:
    """Flush a file, or the names in a folder, to the disk."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
