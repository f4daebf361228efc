"""PostgreSQL, through psycopg 3."""

from functools import cache
from importlib.util import find_spec
from typing import Any

from sqlalchemy import URL, Connection, Engine, NullPool, create_engine, event, text

from eigenfail.errors import InvalidValue, StoreUnavailable
from eigenfail_services.store.distress import AdvisoryLock

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
    "-c synchronous_commit=on -c lock_timeout=30000 "
    "-c tcp_keepalives_idle=5 -c tcp_keepalives_interval=2 -c tcp_keepalives_count=3 "
    "-c tcp_user_timeout=10000"
)

POOL_SIZE = 10
MAX_OVERFLOW = 20
POOL_WAIT_S = 10.0

# disk_full, io_error, read_only_sql_transaction
UNWRITABLE = frozenset({"53100", "58030", "25006"})

# Whoever stands still in the middle of a change holds what it has locked. Readers lock nothing.
# The first limit ends who does so between two statements; in the midst of one, as rows are handed
# over, the second alone does, and servers know it from 17 on.
LIMITS = {"idle_in_transaction_session_timeout": "10s", "transaction_timeout": "30s"}
SINCE = {"transaction_timeout": (17,)}

SCHEMA_LOCK = text("SELECT pg_advisory_xact_lock(hashtext('eigenfail_schema'))")


class Postgres:
    """The database at a server."""

    remedy = "Check that the server runs, and the address, user and password."

    def __init__(self, url: URL) -> None:
        query = {name: _one(value) for name, value in url.query.items()}
        host = url.host or query.get("host", "")
        if "@" in host:
            # What stands before it is the rest of a password, and would be printed as a host.
            raise InvalidValue(
                "database", "The address has more than one @.", "Write %40 for an @ in a password."
            )
        options = f"{OPTIONS} {query.get('options', '')}".strip()
        self._url = url.set(
            drivername="postgresql+psycopg", query={**QUERY, **query, "options": options}
        )
        self.secrets = tuple(filter(None, (url.password, query.get("password"))))
        self.label = f"postgresql://{host}/{url.database or ''}"
        shown = {name: value for name, value in query.items() if name != "password"}
        bare = URL.create("postgresql", url.username, None, url.host, url.port, url.database, shown)
        self.address = bare.render_as_string()

    def engine(self) -> Engine:
        """For everyday work."""
        engine = create_engine(
            self._url,
            isolation_level="READ COMMITTED",
            hide_parameters=True,
            pool_size=POOL_SIZE,
            max_overflow=MAX_OVERFLOW,
            pool_timeout=POOL_WAIT_S,
            pool_pre_ping=True,
        )
        event.listen(engine, "begin", begin)
        return knowing_text(engine)

    def schema_engine(self) -> Engine:
        """For migrations."""
        engine = create_engine(
            self._url, isolation_level="READ COMMITTED", hide_parameters=True, poolclass=NullPool
        )
        return knowing_text(engine)

    def prepare(self) -> None:
        """Nothing more: databases are made by whoever runs the server."""
        self.require()

    def require(self) -> None:
        """Refuse to go on without the driver, which comes with an extra."""
        if find_spec("psycopg") is None:
            raise StoreUnavailable(
                "PostgreSQL's driver is not installed.", "Run: pip install 'eigenfail[postgres]'."
            )

    def lock_schema(self, connection: Connection) -> None:
        """One program at a time looks at the schema and changes it."""
        connection.execute(SCHEMA_LOCK)

    def refuses_writes(self, error: object) -> bool:
        """Whether there is no room, or the server or its disk takes no writes."""
        return getattr(error, "sqlstate", None) in UNWRITABLE

    def signal(self) -> AdvisoryLock:
        """A lock at the server."""
        return AdvisoryLock(self.schema_engine())


def knowing_text(engine: Engine) -> Engine:
    """The same, which refuses a database that keeps bytes and does not know what text they are."""
    # Before SQLAlchemy asks the server anything: it takes the answers for text.
    event.listen(engine, "connect", refuse_bytes, insert=True)
    return engine


def refuse_bytes(connection: Any, _record: object) -> None:
    """Raises InvalidValue for a database in SQL_ASCII."""
    name = connection.info.dbname
    if connection.info.parameter_status("server_encoding") == "SQL_ASCII":
        connection.close()
        raise InvalidValue(
            "database",
            f"'{name}' keeps text in no encoding (SQL_ASCII).",
            "Make one that does, and name that: CREATE DATABASE eigenfail TEMPLATE template0 "
            "ENCODING 'UTF8'.",
        )


def begin(connection: Connection) -> None:
    """Give writers a limit on how long they may stand still."""
    if connection.get_execution_options().get("writes", False):
        connection.exec_driver_sql(limiting(connection.dialect.server_version_info or ()))


@cache
def limiting(server: tuple[int, ...]) -> str:
    """The statement that limits the transaction in which it stands, at a server of some version."""
    known = {name: limit for name, limit in LIMITS.items() if server >= SINCE.get(name, ())}
    return "SELECT " + ", ".join(
        f"set_config('{name}', '{limit}', true)" for name, limit in known.items()
    )


def _one(value: str | tuple[str, ...]) -> str:
    return value if isinstance(value, str) else value[-1]
