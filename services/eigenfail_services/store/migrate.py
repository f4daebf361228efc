"""Brings a database to the schema that this program was made for, or says why not."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from sqlalchemy import Connection, MetaData, Table, inspect, select
from sqlalchemy.exc import ProgrammingError

import eigenfail_services
from eigenfail.errors import SchemaMismatch
from eigenfail_services.store.engine import Backend, Database, find, translated, unavailable
from eigenfail_services.store.refusals import upgrade_command
from eigenfail_services.store.schema import VERSION, VERSION_TABLE, metadata


def folder() -> Path:
    """The migrations: inside the package when installed, at the root of a checkout."""
    package = Path(eigenfail_services.__file__).parent
    shipped = package / "migrations"
    return shipped if shipped.is_dir() else package.parents[1] / "migrations"


def version(connection: Connection) -> str | None:
    """The schema's version; None for a database without any of our tables.

    Raises:
        SchemaMismatch: somebody else's tables have the names of ours.
    """
    tables = set(inspect(connection).get_table_names())
    if VERSION_TABLE in tables:
        record = Table(VERSION_TABLE, MetaData(), autoload_with=connection)
        return connection.execute(select(record.c.version_num)).scalar()
    if taken := sorted(tables & set(metadata.tables)):
        raise SchemaMismatch(
            f"The database has tables named {', '.join(taken)}, but they are not eigenfail's.",
            "Give eigenfail a database of its own.",
        )
    return None


def ensure(database: Database, backend: Backend, *, migrate: bool) -> None:
    """See to it that the schema is the newest: made if there is none, upgraded if it is older.

    Raises:
        SchemaMismatch: it is newer than this program, or may not be changed here.
    """
    with database.reading() as connection:
        found = version(connection)
    if found == VERSION:
        return
    if not migrate:
        raise SchemaMismatch(
            f"The schema of {backend.label} is {found or 'empty'}, not {VERSION}.",
            f"Run: {upgrade_command(backend.address)}.",
        )
    upgrade_with(backend)


def current(address: str) -> str | None:
    """The schema version of the database at an address; None if it is empty.

    Raises:
        StoreUnavailable: there is none, or it does not answer.
    """
    backend = find(address)
    backend.require()
    database = Database(backend)
    try:
        with database.reading() as connection:
            return version(connection)
    finally:
        database.close()


def upgrade(address: str) -> None:
    """Bring the database at an address to the newest schema: all of the way, or not at all.

    Raises:
        SchemaMismatch: it is newer than this program, or not ours.
        StoreUnavailable: it cannot be reached or changed.
    """
    upgrade_with(find(address))


def upgrade_with(backend: Backend) -> None:
    """The same, for a backend."""
    from eigenfail_services.store import steps

    with changing(backend) as connection:
        steps.refuse_newer(version(connection), backend.label)
        steps.upgrade(connection)


def downgrade(address: str, revision: str) -> None:
    """Take the database at an address back to an older schema; `base` removes everything."""
    from eigenfail_services.store import steps

    backend = find(address)
    with changing(backend) as connection:
        steps.refuse_newer(version(connection), backend.label)
        steps.downgrade(connection, revision)


@contextmanager
def changing(backend: Backend) -> Iterator[Connection]:
    """A transaction in which nobody else changes the schema."""
    engine = backend.schema_engine().execution_options(writes=True)
    with translated(backend):
        backend.prepare()
        try:
            with engine.begin() as connection:
                backend.lock_schema(connection)
                yield connection
        except ProgrammingError as error:
            # Here it is a right that is missing, not a statement that is wrong.
            raise unavailable(backend, error) from None
