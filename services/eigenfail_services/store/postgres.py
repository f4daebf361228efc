"""PostgreSQL, through psycopg 3."""

from importlib.util import find_spec

from sqlalchemy import URL, Connection, Engine, NullPool, create_engine, text

from eigenfail.errors import StoreUnavailable

# libpq's own names. A server that has gone silent is given up after about ten seconds.
QUERY = {
    "connect_timeout": "3",
    "keepalives_idle": "5",
    "keepalives_interval": "2",
    "keepalives_count": "3",
    "tcp_user_timeout": "10000",
    "application_name": "eigenfail",
}
OPTIONS = "-c synchronous_commit=on -c lock_timeout=30000"

POOL_SIZE = 10
MAX_OVERFLOW = 20
POOL_WAIT_S = 10.0

SCHEMA_LOCK = text("SELECT pg_advisory_xact_lock(hashtext('eigenfail_schema'))")


class Postgres:
    """The database at a server."""

    remedy = "Check that the server runs, and the address, user and password."

    def __init__(self, url: URL) -> None:
        query = {name: _one(value) for name, value in url.query.items()}
        host = url.host or query.get("host", "")
        if "@" in host:
            # What stands before it is the rest of a password, and would be printed as a host.
            raise StoreUnavailable(
                "The database's address has more than one @.", "Write %40 for an @ in a password."
            )
        options = f"{OPTIONS} {query.get('options', '')}".strip()
        self._url = url.set(
            drivername="postgresql+psycopg", query={**QUERY, **query, "options": options}
        )
        self.secrets = tuple(filter(None, (url.password, query.get("password"))))
        self.label = f"postgresql://{host}/{url.database or ''}"

    def engine(self) -> Engine:
        """For everyday work."""
        return create_engine(
            self._url,
            isolation_level="READ COMMITTED",
            hide_parameters=True,
            pool_size=POOL_SIZE,
            max_overflow=MAX_OVERFLOW,
            pool_timeout=POOL_WAIT_S,
            pool_pre_ping=True,
        )

    def schema_engine(self) -> Engine:
        """For migrations."""
        return create_engine(
            self._url, isolation_level="READ COMMITTED", hide_parameters=True, poolclass=NullPool
        )

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


def _one(value: str | tuple[str, ...]) -> str:
    return value if isinstance(value, str) else value[-1]
