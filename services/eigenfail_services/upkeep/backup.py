"""Backups: all of a database in one file, whole or not there; and back again, all or nothing."""

import os
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Protocol

from sqlalchemy import URL, make_url

from eigenfail.errors import Conflict, ServiceError
from eigenfail.values.upkeep import Backup
from eigenfail_services.store.engine import find
from eigenfail_services.store.steps import refuse_newer
from eigenfail_services.upkeep.dumps import Dumps
from eigenfail_services.upkeep.sqlite_files import SqliteFiles

DRAFT = ".part"


class Keeper(Protocol):
    """What differs between kinds of databases."""

    def holds(self, file: Path) -> bool:
        """Whether a file, by whatever path, is one that the database is made of."""

    def save(self, draft: Path) -> None:
        """Write everything to a file, as of one moment, while others may write.

        Raises:
            ServiceError: the database cannot be read, or the file not written.
        """

    def revision(self, file: Path) -> str:
        """The schema's revision in a backup that is whole.

        Raises:
            InvalidValue: the file is none.
        """

    def load(self, file: Path, *, force: bool) -> None:
        """Put a backup in the place of what the database holds: all of it or nothing.

        Raises:
            Conflict: it holds something, and `force` does not say that this may go.
            ServiceError: somebody uses it, or it cannot be written.
        """


KEEPERS: Mapping[str, Callable[[URL], Keeper]] = {
    "sqlite": SqliteFiles,
    "postgresql": Dumps,
    "postgres": Dumps,
}


def keeper_of(address: str) -> Keeper:
    """What saves and loads the database at an address that `find` has read."""
    url = make_url(address)
    return KEEPERS[url.get_backend_name()](url)


def backup(address: str, file: Path, *, force: bool = False) -> Backup:
    """Write a backup; the file has its name only once it is whole, checked and on the disk.

    Args:
        address: of the database; a service may use it meanwhile.
        file: to write; its folder must be there.
        force: whether it may take the place of another file.

    Raises:
        InvalidValue: the address is none.
        Conflict: there is such a file, or it is the database's own.
        ServiceError: the database cannot be read, or the file not written.
    """
    backend = find(address)
    backend.require()
    keeper = keeper_of(address)
    refuse_existing(file, keeper, force)
    with draft_of(file) as draft:
        keeper.save(draft)
        revision, size = keeper.revision(draft), draft.stat().st_size
        sync(draft)
        refuse_existing(file, keeper, force)
        draft.replace(file)
        sync(file.parent)
    return Backup(backend.label, str(file), size, revision)


def restore(address: str, file: Path, *, force: bool = False) -> Backup:
    """Put a backup in the place of what a database holds: all of it, or nothing is changed.

    Args:
        address: of the database, which nobody may use meanwhile.
        file: a backup.
        force: whether what the database holds may go.

    Raises:
        InvalidValue: the address is none, or the file is no backup.
        Conflict: the database is not empty.
        SchemaMismatch: the backup is of a newer program.
        ServiceError: somebody uses the database, or it cannot be written.
    """
    backend, keeper = find(address), keeper_of(address)
    revision = keeper.revision(file)
    refuse_newer(revision, str(file))
    backend.prepare()
    keeper.load(file, force=force)
    return Backup(backend.label, str(file), file.stat().st_size, revision)


def refuse_existing(file: Path, keeper: Keeper, force: bool) -> None:
    """Raises Conflict where a file must not be overwritten; the database's own never may."""
    if keeper.holds(file):
        raise Conflict(f"{file} is the database itself.", "Name another file.")
    if file.exists() and not force:
        raise Conflict(f"{file} is there already.", "Name another file, or say --force.")


@contextmanager
def draft_of(file: Path) -> Iterator[Path]:
    """A file beside it that nobody else may read, gone after the block unless it was renamed.

    Raises:
        ServiceError: it cannot be written.
    """
    with writing(file):
        handle, name = tempfile.mkstemp(DRAFT, f".{file.name}.", file.parent)
        os.close(handle)
        draft = Path(name)
        try:
            yield draft
        finally:
            draft.unlink(missing_ok=True)


@contextmanager
def writing(file: Path) -> Iterator[None]:
    """Let the system's troubles out as ServiceError.

    Raises:
        ServiceError: the file cannot be written.
    """
    try:
        yield
    except OSError as error:
        raise ServiceError(
            f"The backup {file} cannot be written: {error.strerror}.",
            "Check that its folder exists, can be written and has room.",
        ) from error


def sync(path: Path) -> None:
    """What was written to a file, or the names in a folder, is on the disk."""
    handle = os.open(path, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)
