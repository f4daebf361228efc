"""Schema versions: how a database is brought to the schema of this program, or refused."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

from sqlalchemy import Connection, MetaData, Table, inspect, select
from sqlalchemy.exc import ProgrammingError

import eigenfail_services
from eigenfail.errors import SchemaMismatch
from eigenfail_services.store.engine import (
    Backend,
    Database,
    find_backend,
    to_unavailable,
    translate_errors,
)
from eigenfail_services.store.errors import format_upgrade_command
from eigenfail_services.store.schema import VERSION, VERSION_TABLE, metadata

if TYPE_CHECKING:
    from alembic.config import Config


def find_migrations() -> Path:
    """Return the folder of the migrations: in the installed package, or in a checkout's root."""
    package = Path(eigenfail_services.__file__).parent
    shipped = package / "migrations"
    return shipped if shipped.is_dir() else package.parents[1] / "migrations"


def find_version(connection: Connection) -> str | None:
    """Return the version of a database's schema; None for a database without tables of eigenfail.

    Raises:
        SchemaMismatch: tables of another program have the names of eigenfail's tables.
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


def ensure_newest(database: Database, backend: Backend, *, migrate: bool) -> None:
    """Bring the schema to the newest version, from none or an older one.

    Raises:
        SchemaMismatch: it is newer than this program, or may not be changed here.
    """
    with database.reading() as connection:
        found = find_version(connection)
    if found == VERSION:
        return
    if not migrate:
        raise SchemaMismatch(
            f"The schema of {backend.label} is {found or 'empty'}, not {VERSION}.",
            f"Run: {format_upgrade_command(backend.address)}.",
        )
    upgrade_with(backend)


def read_version(address: str) -> str | None:
    """Return the schema version of the database at an address; None if it is empty.

    Raises:
        StoreUnavailable: there is none, or it does not answer.
    """
    backend = find_backend(address)
    backend.require()
    database = Database(backend)
    try:
        with database.reading() as connection:
            return find_version(connection)
    finally:
        database.close()


def upgrade(address: str) -> None:
    """Bring the database at an address to the newest schema: all of the way, or not at all.

    Raises:
        SchemaMismatch: it is newer than this program, or not ours.
        StoreUnavailable: it cannot be reached or changed.
    """
    upgrade_with(find_backend(address))


def upgrade_with(backend: Backend) -> None:
    """Bring the database of a backend to the newest schema.

    Raises:
        SchemaMismatch: the schema is newer than this program, or not eigenfail's.
        StoreUnavailable: the database cannot be reached or changed.
    """
    # Importing Alembic takes a quarter of a second, and most starts need none of it.
    from alembic import command

    with schema_transaction(backend) as connection:
        # The version is read again under the lock: another process may have upgraded the schema
        # meanwhile.
        refuse_unknown(find_version(connection), backend.label)
        command.upgrade(alembic_config(connection), "head")


def alembic_config(connection: Connection | None = None) -> Config:
    """Return Alembic's settings: the folder of the migrations, and their transaction."""
    from alembic.config import Config

    config = Config()
    # Alembic reads its options with ConfigParser, in which a single % begins a reference.
    config.set_main_option("script_location", str(find_migrations()).replace("%", "%%"))
    config.attributes["connection"] = connection
    return config


def list_revisions() -> list[str]:
    """Return all schema versions that this program knows, oldest first."""
    from alembic.script import ScriptDirectory

    script = ScriptDirectory.from_config(alembic_config())
    return [revision.revision for revision in script.walk_revisions()][::-1]


def refuse_unknown(version: str | None, label: str) -> None:
    """Refuse to touch a database that another version of eigenfail made.

    Raises:
        SchemaMismatch: no migration of this program leads from that version.
    """
    if version is not None and version not in list_revisions():
        raise SchemaMismatch(
            f"The schema of {label} is {version}, which this version of eigenfail does not know; "
            f"its own is {VERSION}.",
            "Use the version of eigenfail that made the database, or another database; this one "
            "was not changed.",
        )


@contextmanager
def schema_transaction(backend: Backend) -> Iterator[Connection]:
    """Give a transaction in which no other program changes the schema."""
    engine = backend.schema_engine().execution_options(writes=True)
    with translate_errors(backend):
        backend.prepare()
        try:
            with engine.begin() as connection:
                backend.lock_schema(connection)
                yield connection
        except ProgrammingError as error:
            # Here it is a right that is missing, not a statement that is wrong.
            raise to_unavailable(backend, error) from None
