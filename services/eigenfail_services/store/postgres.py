"""PostgreSQL, through psycopg 3."""

from functools import cache
from importlib.util import find_spec
from typing import Any

import sqlalchemy as sa

from eigenfail.errors import InvalidValue, StoreUnavailable, StoreUnwritable
from eigenfail_services.store.alarms import AdvisoryLock
from eigenfail_services.store.schema import event_counter, metadata

# libpq's own names. A server that has gone silent is given up after about ten seconds.
QUERY = {
    "connect_timeout": "3",
    "keepalives_idle": "5",
    "keepalives_interval": "2",
    "keepalives_count": "3",
    "tcp_user_timeout": "10000",
    "application_name": "eigenfail",
}
# The second line is what the server does where this host is the one that has gone silent.
OPTIONS = (
    "-c synchronous_commit=on "
    "-c tcp_keepalives_idle=5 -c tcp_keepalives_interval=2 -c tcp_keepalives_count=3 "
    "-c tcp_user_timeout=10000"
)

POOL_SIZE = 10
MAX_OVERFLOW = 20
POOL_WAIT_S = 10.0

# disk_full, io_error, read_only_sql_transaction
UNWRITABLE = frozenset({"53100", "58030", "25006"})

# A client that stops in the middle of a change keeps its locks. Readers lock nothing.
# The first limit ends who does so between two statements; in the midst of one, as rows are handed
# over, the second alone does, and servers know it from 17 on.
LIMITS = {"idle_in_transaction_session_timeout": "10s", "transaction_timeout": "30s"}
SINCE = {"transaction_timeout": (17,)}

# query_canceled, lock_not_available
TOOK_TOO_LONG = frozenset({"57014", "55P03"})
LOCKED = (
    "A session at the server holds its lock (pg_stat_activity and pg_locks name it): wait for it, "
    "or end it; then the service goes on by itself."
)
# data_corrupted, index_corrupted
DAMAGES = frozenset({"XX001", "XX002"})
# libpq gives no code for a connection that is refused, and the words alone tell these.
FULL = ("too many clients", "too many connections", "remaining connection slots are reserved")
CROWDED = (
    "Raise max_connections of the server, or stop other programs that use it: a process of "
    "eigenfail opens up to 30 connections."
)
DAMAGED = (
    "Stop the service; the server's log names the damage. Put a backup in the database's place: "
    "`pg_restore --clean --if-exists --single-transaction`."
)
UNREACHABLE = "Check that the server runs, and the address, user and password."

PROBE_LIMIT = "SET LOCAL statement_timeout = '2s'"
# Shorter than the second after which the server looks for deadlocks: a probe that holds some tables
# and waits for another never ends the migration that waits for it.
PROBE_LOCK_LIMIT = "SET LOCAL lock_timeout = '500ms'"
TABLES = ", ".join(f'"{table}"' for table in metadata.tables)
TAKE_LOCKS = f"LOCK TABLE {TABLES} IN ROW EXCLUSIVE MODE"
"""Locks that every writer takes: a session that keeps out readers or writers blocks them, too."""

TAKES_WRITES = "SHOW transaction_read_only"

SCHEMA_LOCK = sa.text("SELECT pg_advisory_xact_lock(hashtext('eigenfail_schema'))")


class Postgres:
    """The database of a PostgreSQL server."""

    def __init__(self, address: str, wait_s: float) -> None:
        url = sa.make_url(address)
        # Of a parameter that is given several times the last one counts.
        query = {name: values[-1] for name, values in url.normalized_query.items()}
        host = url.host or query.get("host", "")
        if "@" in host:
            # What stands before it is the rest of a password, and would be printed as a host.
            raise InvalidValue(
                "database", "The address has more than one @.", "Write %40 for an @ in a password."
            )
        waits = f"-c lock_timeout={round(wait_s * 1_000)}"
        options = f"{OPTIONS} {waits} {query.get('options', '')}".strip()
        self._url = url.set(
            drivername="postgresql+psycopg", query={**QUERY, **query, "options": options}
        )
        self.secrets = tuple(filter(None, (url.password, query.get("password"))))
        self.label = f"postgresql://{host}/{url.database or ''}"
        shown = {name: value for name, value in query.items() if name != "password"}
        bare = sa.URL.create(
            "postgresql", url.username, None, url.host, url.port, url.database, shown
        )
        # SQLAlchemy leaves a space unquoted, or writes a + in a query; PostgreSQL's own programs
        # know %20 alone.
        place, mark, options = bare.render_as_string().partition("?")
        self.address = place.replace(" ", "%20") + mark + options.replace("+", "%20")

    def engine(self) -> sa.Engine:
        """Return the engine for everyday work."""
        engine = sa.create_engine(
            self._url,
            isolation_level="READ COMMITTED",
            hide_parameters=True,
            pool_size=POOL_SIZE,
            max_overflow=MAX_OVERFLOW,
            pool_timeout=POOL_WAIT_S,
            pool_pre_ping=True,
        )
        sa.event.listen(engine, "begin", _begin)
        return require_encoding(engine)

    def schema_engine(self) -> sa.Engine:
        """Return the engine for migrations."""
        engine = sa.create_engine(
            self._url, isolation_level="READ COMMITTED", hide_parameters=True, poolclass=sa.NullPool
        )
        return require_encoding(engine)

    def prepare(self) -> None:
        """Check for the driver; the server's administrator creates databases."""
        self.require()

    def require(self) -> None:
        """Refuse to go on without the driver, which comes with an extra."""
        if find_spec("psycopg") is None:
            raise StoreUnavailable(
                "PostgreSQL's driver is not installed.",
                "Run in a clone: pip install '.[postgres]'.",
            )

    def lock_schema(self, connection: sa.Connection) -> None:
        """Let one program at a time look at the schema and change it."""
        connection.execute(SCHEMA_LOCK)

    def refuses_writes(self, error: object) -> bool:
        """Return whether the disk is full, or the server or its disk is read-only."""
        return getattr(error, "sqlstate", None) in UNWRITABLE

    def remedy_of(self, error: object) -> str:
        """Return what a user can do about a lock, damaged data or a server that is out of reach."""
        if self.is_damage(error):
            return DAMAGED
        if self.is_full(error):
            return CROWDED
        return LOCKED if getattr(error, "sqlstate", None) in TOOK_TOO_LONG else UNREACHABLE

    def is_full(self, error: object) -> bool:
        """Return whether the server, the database or the user has all connections it may have."""
        return any(words in str(error) for words in FULL)

    def is_damage(self, error: object) -> bool:
        """Return whether a page of a table or of an index is damaged."""
        return getattr(error, "sqlstate", None) in DAMAGES

    def check(self, connection: sa.Connection) -> None:
        """Do nothing: a connection to the server is one to the database."""

    def probe(self, connection: sa.Connection) -> None:
        """Check that the server takes writes and locks no table, for two seconds at most."""
        connection.exec_driver_sql(PROBE_LIMIT)
        connection.exec_driver_sql(PROBE_LOCK_LIMIT)
        connection.execute(sa.select(event_counter.c.last)).scalar_one()
        if connection.exec_driver_sql(TAKES_WRITES).scalar_one() != "off":
            raise StoreUnwritable(
                f"The server of {self.label} takes no writes: it is a standby or read-only.",
                "Name the primary server, or let it take writes.",
            )
        connection.exec_driver_sql(TAKE_LOCKS)

    def signal(self) -> AdvisoryLock:
        """Return an advisory lock at the server."""
        return AdvisoryLock(self.schema_engine())


def require_encoding(engine: sa.Engine) -> sa.Engine:
    """Let an engine refuse databases that store text without an encoding."""
    # Before SQLAlchemy asks the server anything: it takes the answers for text.
    sa.event.listen(engine, "connect", _refuse_ascii, insert=True)
    return engine


def _refuse_ascii(connection: Any, _record: object) -> None:
    """Raise InvalidValue for a database in SQL_ASCII."""
    name = connection.info.dbname
    if connection.info.parameter_status("server_encoding") == "SQL_ASCII":
        connection.close()
        raise InvalidValue(
            "database",
            f"'{name}' keeps text in no encoding (SQL_ASCII).",
            "Make one that does, and name that: CREATE DATABASE eigenfail TEMPLATE template0 "
            "ENCODING 'UTF8'.",
        )


def _begin(connection: sa.Connection) -> None:
    """Limit how long a writing transaction may stand still."""
    if connection.get_execution_options().get("writes", False):
        connection.exec_driver_sql(limit_statement(connection.dialect.server_version_info or ()))


@cache
def limit_statement(server: tuple[int, ...]) -> str:
    """Return the statement that limits its own transaction, for a version of the server."""
    known = {name: limit for name, limit in LIMITS.items() if server >= SINCE.get(name, ())}
    return "SELECT " + ", ".join(
        f"set_config('{name}', '{limit}', true)" for name, limit in known.items()
    )
