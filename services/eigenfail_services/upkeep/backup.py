"""Whole databases of SQLite: a backup in one file, its restoration, and free space given back.

Copies use SQLite's online backup. For PostgreSQL, users run PostgreSQL's own programs.
"""

import os
import sqlite3
import tempfile
from collections.abc import Iterator
from contextlib import closing, contextmanager
from pathlib import Path

from eigenfail.addresses import sqlite_path, sqlite_uri
from eigenfail.errors import Conflict, InvalidValue, ServiceError
from eigenfail.values.operations import Backup, Vacuumed
from eigenfail_services.store.engine import find_backend, read_kind
from eigenfail_services.store.migrate import refuse_unknown
from eigenfail_services.store.schema import (
    VERSION_TABLE,
    event_counter,
    is_own_table,
    plugin_versions,
)
from eigenfail_services.store.sqlite import find_mode
from eigenfail_services.store.store import open_store

FILLED = {VERSION_TABLE, event_counter.name, plugin_versions.name}
"""The tables that have rows in a new database."""


def _explain_no_backup(file: Path, why: str) -> InvalidValue:
    """Return the error for a file that is not a backup."""
    remedy = "Specify a file created by `eigenfail db backup`."
    return InvalidValue("file", f"'{file}' is not an eigenfail backup: {why}.", remedy)


LOCK_TIMEOUT_S = 1.0
"""Time for other programs to release the database before it counts as in use."""

FILE_SUFFIXES = ("", "-wal", "-shm", "-journal")
"""Endings of the names of a database's files; some exist only while it is open."""

SELECT_TABLES = (
    "SELECT name FROM sqlite_master WHERE type = 'table' AND substr(name, 1, 7) <> 'sqlite_'"
)


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
    if strange := sorted(name for name in names if not is_own_table(name)):
        raise Conflict(
            f"{path} has tables that are not eigenfail's: {', '.join(strange)}.",
            "Restore into a database of its own.",
        )


def _refuse_rows(path: Path, connection: sqlite3.Connection) -> None:
    """Raise Conflict if a table has a row."""
    names = {name for (name,) in connection.execute(SELECT_TABLES)} - FILLED
    if any(connection.execute(f'SELECT 1 FROM "{name}" LIMIT 1').fetchone() for name in names):  # noqa: S608 - of `SELECT_TABLES`
        raise Conflict(
            f"{path} is not empty.",
            "Restore into another one, or add --force: the contents of this one are then lost.",
        )


@contextmanager
def translate_sqlite_errors(what: str) -> Iterator[None]:
    """Translate SQLite's errors into ServiceError.

    Args:
        what: the failed operation, as a sentence without its end.

    Raises:
        ServiceError: another program uses the database, it is damaged, or the disk is full.
    """
    remedies = {
        sqlite3.SQLITE_BUSY: "Stop the service that uses it, and whatever else has it open.",
        sqlite3.SQLITE_FULL: (
            "Make room on the disk, and try again; SQLITE_TMPDIR may name a folder on another."
        ),
        sqlite3.SQLITE_NOTADB: "Move the damaged file away, with its -wal and -shm, and try again.",
    }
    try:
        yield
    except sqlite3.Error as error:
        code = getattr(error, "sqlite_errorcode", 0)
        remedy = remedies.get(code, "Check that the folder can be written and has room.")
        raise ServiceError(f"{what}: {error}.", remedy) from error


DRAFT_SUFFIX = ".part"


def backup(address: str, file: Path, *, force: bool = False) -> Backup:
    """Write a backup; the file gets its name only once it is complete, checked and on the disk.

    Args:
        address: address of the database; a service may use it meanwhile.
        file: file to write; its folder must exist.
        force: whether it may replace another file.

    Raises:
        InvalidValue: the address is invalid.
        Conflict: the file exists, or belongs to the database; or the database is PostgreSQL's.
        ServiceError: the database cannot be read, or the file not written.
    """
    backend = find_backend(address)
    instead = "pg_dump --format=custom --no-owner --file=FILE --dbname=DATABASE"
    path = _find_path(address, instead, "docs/deployment.md, Backups")
    backend.require()
    _refuse_existing(file, path, force)
    # A power cut leaves the earlier backup or the whole new one: the content is on the disk before
    # the name changes, and the name before the backup is reported.
    with _open_draft(file) as draft:
        _copy_pages(path, draft)
        # The copy is checked before it replaces an earlier backup.
        revision, size = _read_revision(draft), draft.stat().st_size
        _sync(draft)
        # Another program may have created the file while the pages were copied.
        _refuse_existing(file, path, force)
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
        Conflict: the database is not empty; or it is PostgreSQL's.
        SchemaMismatch: a newer program wrote the backup.
        ServiceError: the database is in use, or cannot be written.
    """
    instead = "pg_restore --clean --if-exists --single-transaction --dbname=DATABASE FILE"
    path = _find_path(address, instead, "docs/deployment.md, Backups")
    if file.exists() and not file.is_file():
        # A pipe or a device would be waited for.
        raise _explain_no_backup(file, "it is not a regular file.")
    # The backup is checked before a database is created or changed.
    revision = _read_revision(file)
    refuse_unknown(revision, str(file))
    backend = find_backend(address)
    backend.prepare()
    _replace_pages(path, file, force=force)
    return Backup(backend.label, str(file), file.stat().st_size, revision)


def vacuum(address: str) -> Vacuumed:
    """Give the space of deleted rows back to the disk.

    SQLite copies the database into a new file: it must not be in use meanwhile, and there must be
    room for both.

    Raises:
        InvalidValue: the address is invalid.
        Conflict: the database is PostgreSQL's, which gives space back by itself.
        StoreUnavailable: the database does not exist, or does not answer.
        SchemaMismatch: its schema is not this program's.
        ServiceError: the database is in use, or there is not enough room to work in.
    """
    instead = 'psql --command="VACUUM (ANALYZE)" DATABASE'
    path = _find_path(address, instead, "docs/scale.md")
    # Opening it refuses a database that is not this program's, before its file is rewritten.
    open_store(address, migrate=False).close()
    before = _measure(path)
    with (
        translate_sqlite_errors(f"{path} was not changed"),
        closing(open_sqlite(path, "rw", LOCK_TIMEOUT_S)) as connection,
    ):
        # SQLite refuses to change the mode of a database that another program has open. Without
        # this, writers of a running service would wait in vain for minutes.
        connection.execute("PRAGMA journal_mode = DELETE")
        connection.execute("VACUUM")
        connection.execute("PRAGMA journal_mode = WAL")
    return Vacuumed(find_backend(address).label, before, _measure(path))


def _measure(path: Path) -> int:
    """Return the size of a database with its companion files. [bytes]"""
    files = (path.with_name(path.name + ending) for ending in FILE_SUFFIXES)
    return sum(file.stat().st_size for file in files if file.exists())


def _find_path(address: str, instead: str, document: str) -> Path:
    """Return the path of a SQLite database.

    Raises:
        Conflict: the database is PostgreSQL's; the remedy is the command to run instead.
    """
    if read_kind(address) == "sqlite":
        return sqlite_path(address)
    raise Conflict(
        "PostgreSQL has programs of its own for this.", f"Run: {instead} (see {document})."
    )


def _copy_pages(path: Path, draft: Path) -> None:
    """Copy all pages as of one moment; meanwhile others write to the write-ahead log."""
    with (
        translate_sqlite_errors(f"The backup of {path} failed"),
        closing(open_sqlite(path, find_mode(path))) as source,
        closing(open_sqlite(draft, "rw")) as target,
    ):
        source.backup(target)
        # A single file without a log can be read where nothing can be written.
        target.execute("PRAGMA journal_mode = DELETE")


def _read_revision(file: Path) -> str:
    """Return the schema's revision in an undamaged file.

    Raises:
        InvalidValue: the file is not a complete backup.
    """
    try:
        with closing(open_backup(file)) as source:
            _refuse_damage(source)
            (found,) = source.execute(f"SELECT version_num FROM {VERSION_TABLE}").fetchone()  # noqa: S608 - a name of ours
            return str(found)
    except (sqlite3.Error, TypeError) as error:
        raise _explain_no_backup(file, str(error)) from error


def _replace_pages(path: Path, file: Path, *, force: bool) -> None:
    """Write all pages in one transaction.

    Raises:
        Conflict: the database is not empty, and `force` is not set.
        ServiceError: the database is in use, or cannot be written.
    """
    with (
        translate_sqlite_errors(f"{path} was not changed"),
        closing(open_backup(file)) as source,
        closing(open_sqlite(path, "rw", LOCK_TIMEOUT_S)) as target,
    ):
        # SQLite refuses to change the mode of a database that another program has open.
        target.execute("PRAGMA journal_mode = DELETE")
        _refuse_foreign_tables(path, target)
        if not force:
            _refuse_rows(path, target)
        source.backup(target)
        _refuse_damage(target)


def _refuse_existing(file: Path, path: Path, force: bool) -> None:
    """Raise Conflict if a file must not be overwritten; the database's own files never may be."""
    if belongs_to(path, file):
        raise Conflict(f"{file} is the database itself.", "Name another file.")
    if file.exists() and not force:
        raise Conflict(f"{file} exists already.", "Name another file, or add --force.")


def belongs_to(path: Path, file: Path) -> bool:
    """Return whether a file is the database's file, or a companion file of SQLite."""
    whole, named = path.resolve(), file.resolve()
    own = [whole.with_name(whole.name + ending) for ending in FILE_SUFFIXES]
    # A hard link has another path, and a file that does not exist yet has a path alone.
    return named in own or any(
        each.exists() and file.exists() and each.samefile(file) for each in own
    )


@contextmanager
def _open_draft(file: Path) -> Iterator[Path]:
    """Yield a private file in the same folder, which is deleted after the block unless renamed."""
    with _translate_os_errors(file):
        # Only within one folder is a rename atomic for sure; another folder may be on another disk.
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
