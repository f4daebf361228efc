"""Schema versions: how a database is brought to the schema of this program, or refused."""

from __future__ import annotations

import logging
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from sqlalchemy import Connection, MetaData, Table, delete, insert, inspect, select
from sqlalchemy.exc import ProgrammingError

import eigenfail_services
from eigenfail import plugins
from eigenfail.errors import EigenfailError, InvalidValue, SchemaMismatch
from eigenfail_services.store.engine import (
    Backend,
    Database,
    find_backend,
    to_unavailable,
    translate_errors,
)
from eigenfail_services.store.errors import format_upgrade_command
from eigenfail_services.store.schema import (
    PLUGIN_PREFIX,
    VERSION,
    VERSION_TABLE,
    metadata,
    plugin_versions,
)

if TYPE_CHECKING:
    from alembic.config import Config

log = logging.getLogger(__name__)


def _keep_tables(_connection: Connection, _found: int) -> None:
    """Change nothing: no version is older than the first one."""


@dataclass(frozen=True, eq=False)
class PluginTables:
    """Tables of a plug-in, which an entry point of the group `eigenfail.tables` names.

    Attributes:
        metadata: the tables. The tables of the plug-in `sheep` are called `plugin_sheep`, or their
            names begin with `plugin_sheep_`.
        version: rises by 1 with each release that changes the tables.
        upgrade: changes the tables from a given older version, in the connection's transaction. A
            database without the tables gets the tables of `metadata` instead.
    """

    metadata: MetaData
    version: int = 1
    upgrade: Callable[[Connection, int], None] = _keep_tables


def load_plugin_tables() -> dict[str, PluginTables]:
    """Return the tables of the installed plug-ins by name; unusable ones are logged."""
    found = {}
    for name in plugins.names(plugins.TABLES):
        try:
            tables = plugins.load(plugins.TABLES, name)
            _check_tables(name, tables)
        except EigenfailError:
            log.exception("The tables of the plug-in '%s' are left out. All else works.", name)
        else:
            found[name] = tables
    return found


def _check_tables(plugin: str, tables: object) -> None:
    """Raise InvalidValue if a table may belong to the core or to another plug-in by its name."""
    if not isinstance(tables, PluginTables):
        problem = f"'{plugin}' is of the type {type(tables).__name__}, and must be PluginTables."
        raise InvalidValue("table", problem, "Fix its package.")
    # The longest name owns a table: with plug-ins `web` and `web_hooks`, `plugin_web_hooks_queue`
    # belongs to `web_hooks`.
    others = sorted({plugin, *plugins.names(plugins.TABLES)}, key=len, reverse=True)
    for table in tables.metadata.tables:
        begun = (name for name in others if f"{table}_".startswith(f"{PLUGIN_PREFIX}{name}_"))
        if next(begun, None) != plugin:
            own = f"{PLUGIN_PREFIX}{plugin}"
            problem = f"'{plugin}' has a table '{table}', whose name must begin with '{own}'"
            raise InvalidValue("table", f"{problem} and not with another's.", "Fix its package.")


def _upgrade_plugins(connection: Connection, wanted: Mapping[str, PluginTables]) -> None:
    """Create or upgrade the tables of plug-ins.

    Raises:
        SchemaMismatch: a newer release of a plug-in has changed its tables.
    """
    versions = _read_plugin_versions(connection)
    for name, tables in wanted.items():
        found = versions.get(name, 0)
        if found > tables.version:
            raise SchemaMismatch(
                f"The tables of the plug-in '{name}' are of version {found}, and the installed "
                f"plug-in knows version {tables.version}.",
                "Install the newer release of the plug-in, or uninstall it.",
            )
        if found == tables.version:
            continue
        if found:
            tables.upgrade(connection, found)
        else:
            tables.metadata.create_all(connection, checkfirst=False)
        connection.execute(delete(plugin_versions).where(plugin_versions.c.name == name))
        connection.execute(insert(plugin_versions).values(name=name, version=tables.version))


def _read_plugin_versions(connection: Connection) -> dict[str, int]:
    return {row.name: row.version for row in connection.execute(select(plugin_versions))}


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

    Args:
        database: transactions on the database.
        backend: backend of the same database.
        migrate: whether the schema may be changed. If not, tables of plug-ins are not looked at:
            a plug-in may have been installed while the service runs.

    Raises:
        SchemaMismatch: it is newer than this program, or may not be changed here.
    """
    wanted = {name: each.version for name, each in load_plugin_tables().items()} if migrate else {}
    with database.reading() as connection:
        found = find_version(connection)
        is_newest = found == VERSION
        if is_newest and wanted.items() <= _read_plugin_versions(connection).items():
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
        _upgrade_plugins(connection, load_plugin_tables())


def alembic_config(connection: Connection | None = None) -> Config:
    """Return Alembic's settings: the folder of the migrations, and their transaction."""
    from alembic.config import Config

    config = Config()
    # Alembic reads its options with ConfigParser, in which a single % begins a reference.
    config.set_main_option("script_location", str(find_migrations()).replace("%", "%%"))
    config.attributes["connection"] = connection
    return config


def list_revisions() -> list[str]:
    """Return all schema versions in this program's migrations, oldest first."""
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
    """Give a transaction that keeps other programs from changing the schema."""
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
