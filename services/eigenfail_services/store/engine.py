"""Transactions on a database, whatever it is; all trouble comes out as StoreUnavailable."""

from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from typing import Protocol

from sqlalchemy import URL, Connection, Engine, exc, make_url

from eigenfail.errors import InvalidValue, StoreUnavailable, StoreUnwritable
from eigenfail_services.store.distress import Distress, Signal
from eigenfail_services.store.postgres import Postgres
from eigenfail_services.store.sqlite import Sqlite

# Our own mistakes: hiding them behind "unavailable" would have people wait for nothing.
MISTAKES = (exc.IntegrityError, exc.ProgrammingError, exc.DataError, exc.NotSupportedError)


class Backend(Protocol):
    """What differs between databases.

    Attributes:
        label: the address, fit to be shown.
        address: the same, fit to be typed again: whatever is secret in it is left out.
        remedy: what to look at when it is not available.
        secrets: what must not be shown.
    """

    label: str
    address: str
    remedy: str
    secrets: tuple[str, ...]

    def engine(self) -> Engine:
        """For everyday work; transactions with the execution option `writes` may change rows."""

    def schema_engine(self) -> Engine:
        """For migrations."""

    def prepare(self) -> None:
        """Whatever must be there before the first connection."""

    def require(self) -> None:
        """Refuse a database that a connection would make, for those who only look.

        Raises:
            StoreUnavailable: there is none.
        """

    def lock_schema(self, connection: Connection) -> None:
        """Keep other programs from changing the schema until the transaction ends."""

    def refuses_writes(self, error: object) -> bool:
        """Whether a driver's error says that the database can be read, but not written."""

    def signal(self) -> Signal:
        """What all who use the database can see without reading or writing it."""


BACKENDS: Mapping[str, Callable[[URL], Backend]] = {
    "sqlite": Sqlite,
    "postgresql": Postgres,
    "postgres": Postgres,
}

ROOM = "Check that its disk has room and can be written; then it goes on by itself."
FORMS = "sqlite:///folder/file.db or postgresql://user:password@host:5432/database"


def find(address: str) -> Backend:
    """The backend of an address.

    Raises:
        InvalidValue: it is not an address of a database that is supported.
    """
    try:
        url = make_url(address)
        backend = BACKENDS[url.get_backend_name()]
    except (exc.ArgumentError, KeyError, ValueError):
        # The text itself may hold a password, in a place where nobody looks for one.
        raise InvalidValue(
            "database", "The address cannot be read.", f"Write it as {FORMS}."
        ) from None
    return backend(url)


class Database:
    """Hands out transactions; each is committed at the end of its block, or undone by an error."""

    def __init__(self, backend: Backend) -> None:
        self._backend = backend
        self._reader = backend.engine()
        self._writer = self._reader.execution_options(writes=True)
        self._distress = Distress(backend.signal())

    @contextmanager
    def reading(self) -> Iterator[Connection]:
        """A transaction that changes nothing."""
        with translated(self._backend), self._reader.begin() as connection:
            yield connection

    @contextmanager
    def writing(self) -> Iterator[Connection]:
        """A transaction that may change rows."""
        try:
            with translated(self._backend), self._writer.begin() as connection:
                yield connection
        except StoreUnwritable:
            self._distress.call()
            raise

    def ask_writers(self, connection: Connection) -> None:
        """Raises StoreUnwritable if a process on this database said of late that it cannot."""
        if self._distress.is_heard(connection):
            raise StoreUnwritable(
                f"A part of the service cannot write to the database {self._backend.label}: its "
                "disk is full, or it takes no writes. No work is handed out until it does.",
                ROOM,
            )

    def close(self) -> None:
        """Let go of all connections."""
        self._distress.end()
        self._reader.dispose()


@contextmanager
def translated(backend: Backend) -> Iterator[None]:
    """Let a database's troubles out as StoreUnavailable.

    Raises:
        StoreUnavailable: the database cannot be reached, or (StoreUnwritable) not written.
    """
    try:
        yield
    except MISTAKES:
        raise
    except (exc.DatabaseError, exc.InterfaceError, exc.TimeoutError, OSError) as error:
        raise unavailable(backend, error) from None


def unavailable(backend: Backend, error: Exception) -> StoreUnavailable:
    """The error for people: the first line of the driver's complaint, without secrets."""
    complaint = str(getattr(error, "orig", None) or error).strip()
    line = complaint.splitlines()[0] if complaint else type(error).__name__
    for secret in backend.secrets:
        line = line.replace(secret, "***")
    if backend.refuses_writes(getattr(error, "orig", None)):
        problem = f"The database {backend.label} cannot be written: {line.rstrip('.')}."
        return StoreUnwritable(problem, ROOM)
    return StoreUnavailable(
        f"The database {backend.label} is not available: {line.rstrip('.')}.", backend.remedy
    )
