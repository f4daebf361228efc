"""Transactions on a database of any kind; its errors become `StoreUnavailable`."""

import sqlite3
import time
from collections.abc import Callable, Iterable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor, wait
from contextlib import contextmanager
from typing import Concatenate, ParamSpec, Protocol, TypeVar

from sqlalchemy import Connection, Engine, Transaction, exc

from eigenfail.errors import InvalidValue, StoreDamaged, StoreUnavailable, StoreUnwritable
from eigenfail_services.store.alarms import Signal, WriteAlarm
from eigenfail_services.store.postgres import Postgres
from eigenfail_services.store.sqlite import Sqlite

# Our own mistakes: hiding them behind "unavailable" would have people wait for nothing.
MISTAKES = (exc.IntegrityError, exc.ProgrammingError, exc.DataError, exc.NotSupportedError)


class Backend(Protocol):
    """The operations that differ between databases.

    Attributes:
        label: the address, fit to be shown.
        address: the address without secrets, as users type it.
        secrets: texts that must not be shown.
    """

    label: str
    address: str
    secrets: tuple[str, ...]

    def engine(self) -> Engine:
        """Return the engine for everyday work; writers have the execution option `writes`."""

    def schema_engine(self) -> Engine:
        """Return the engine for migrations."""

    def prepare(self) -> None:
        """Create what must exist before the first connection."""

    def require(self) -> None:
        """Refuse a database that does not exist, if a connection would create it.

        Raises:
            StoreUnavailable: the database does not exist.
        """

    def lock_schema(self, connection: Connection) -> None:
        """Keep other programs from changing the schema until the transaction ends."""

    def refuses_writes(self, error: object) -> bool:
        """Return whether a driver's error says that the database cannot be written."""

    def remedy_of(self, error: object) -> str:
        """Return what a user can do about a driver's error."""

    def is_full(self, error: object) -> bool:
        """Return whether a driver's error says that there are too many connections."""

    def is_damage(self, error: object) -> bool:
        """Return whether a driver's error says that stored data were truncated or overwritten."""

    def signal(self) -> Signal:
        """Return a lock that all users of the database see without reading or writing it."""

    def check(self, connection: Connection) -> None:
        """Check that the files of a connection still are the database.

        Raises:
            StoreUnavailable: they were moved, deleted or replaced.
        """

    def probe(self, connection: Connection) -> None:
        """Read from the database itself, and check that a writer would get its lock.

        Bounded in time; nothing is written. Raises StoreUnavailable or an error of the driver.
        """


BACKENDS: Mapping[str, Callable[[str, float], Backend]] = {
    "sqlite": Sqlite,
    "postgresql": Postgres,
    "postgres": Postgres,
}

ROOM = "Check that its disk has room and can be written; then it goes on by itself."
WAIT_S = 10.0
"""Default time that a statement waits for the lock of another program."""

INTERVAL_S = 0.005
"""Time between two calls of what runs while a transaction is committed."""

CROWDED_WAIT_S = 5.0
CROWDED_RETRY_S = 0.05
"""Time and interval of attempts to connect to a server that has too many connections. [s]"""

CHUNK = 500
"""Numbers that one statement names, and rows that are fetched at a time, at most."""

FORMS = "sqlite:///folder/file.db or postgresql://user:password@host:5432/database"


def read_kind(address: str) -> str:
    """Return the kind of database at an address, such as sqlite."""
    return address.partition("://")[0].partition("+")[0]


def find_backend(address: str, wait_s: float = WAIT_S) -> Backend:
    """Return the backend of an address.

    Args:
        address: URL of the database.
        wait_s: how long a statement waits for the lock of another program. [s]

    Raises:
        InvalidValue: the address does not belong to a supported database.
    """
    try:
        return BACKENDS[read_kind(address)](address, wait_s)
    except (exc.ArgumentError, KeyError, ValueError):
        # The text itself may hold a password in an unexpected place.
        raise InvalidValue(
            "database", "The address cannot be read.", f"Write it as {FORMS}."
        ) from None


Given = ParamSpec("Given")
Answer = TypeVar("Answer")

Commit = Callable[[Transaction], None]
"""Commits a transaction; afterwards it is committed, or an error was raised."""


class Database:
    """Gives transactions; each is committed at the end of its block, or rolled back on an error."""

    def __init__(self, backend: Backend) -> None:
        self._backend = backend
        self._reader = backend.engine()
        self._writer = self._reader.execution_options(writes=True)
        self._alarm = WriteAlarm(backend.signal())
        self._threads = ThreadPoolExecutor(1, "commit")

    @contextmanager
    def reading(self) -> Iterator[Connection]:
        """Begin a transaction that changes nothing."""
        with (
            translate_errors(self._backend),
            self._connect(self._reader) as connection,
            connection.begin(),
        ):
            self._backend.check(connection)
            yield connection

    @contextmanager
    def writing(self, commit: Commit = Transaction.commit) -> Iterator[Connection]:
        """Begin a transaction that may change rows.

        Args:
            commit: commits the transaction; see `commit_beside`.

        Raises:
            StoreUnavailable: nothing was written, or the written rows may be lost.
        """
        try:
            with translate_errors(self._backend), self._connect(self._writer) as connection:
                with connection.begin() as transaction:
                    self._backend.check(connection)
                    yield connection
                    self._backend.check(connection)
                    commit(transaction)
                # Once more: only rows that the database holds after the commit are acknowledged.
                self._backend.check(connection)
        except StoreUnwritable:
            self._alarm.begin()
            raise

    def read(
        self,
        question: Callable[Concatenate[Connection, Given], Answer],
        *given: Given.args,
        **options: Given.kwargs,
    ) -> Answer:
        """Return what a function reads in a transaction that changes nothing."""
        with self.reading() as connection:
            return question(connection, *given, **options)

    def write_once(
        self,
        make: Callable[Concatenate[Connection, Given], Answer],
        *given: Given.args,
        **options: Given.kwargs,
    ) -> Answer:
        """Run a function in a writing transaction, and return its answer.

        If another request has written the same key meanwhile, the function runs once more.

        Raises:
            StoreUnavailable: the database does not answer, or stays locked.
        """
        try:
            with self.writing() as connection:
                return make(connection, *given, **options)
        except exc.IntegrityError:
            # Another request used the same key at the same time: now its rows can be read.
            with self.writing() as connection:
                return make(connection, *given, **options)

    def _connect(self, engine: Engine) -> Connection:
        """Return a connection of the pool; wait for one if the server grants no further one.

        Others come free in milliseconds, of this process and of others that share the server.
        """
        until_s = time.monotonic() + CROWDED_WAIT_S
        while True:
            try:
                return engine.connect()
            except exc.OperationalError as error:
                if not self._backend.is_full(error.orig) or time.monotonic() > until_s:
                    raise
                time.sleep(CROWDED_RETRY_S)

    def commit_beside(self, meanwhile: Callable[[], None]) -> Commit:
        """Return a commit in another thread, while `meanwhile` runs in the one that waits for it.

        The database writes, and waits for its disk, without holding up the interpreter. `meanwhile`
        runs again and again: a disk may take long.
        """

        def commit(transaction: Transaction) -> None:
            committed = self._threads.submit(transaction.commit)
            try:
                meanwhile()
                while not wait([committed], INTERVAL_S).done:
                    meanwhile()
            finally:
                # The thread may still be committing if `meanwhile` raised: the transaction must not
                # be closed under it.
                committed.result()

        return commit

    def ask_writers(self, connection: Connection) -> None:
        """Raise StoreUnwritable if a process on this database could not write lately."""
        if self._alarm.is_raised(connection):
            raise StoreUnwritable(
                f"A part of the service cannot write to the database {self._backend.label}: its "
                "disk is full, or it takes no writes. No work is handed out until it does.",
                ROOM,
            )

    def probe(self) -> None:
        """Raise StoreUnavailable if nothing can be read, or no writer gets its lock."""
        with self.reading() as connection:
            self.ask_writers(connection)
            self._backend.probe(connection)

    def close(self) -> None:
        """Close all connections."""
        self._threads.shutdown()
        self._alarm.end()
        self._reader.dispose()


class StorePart:
    """A part of the store.

    Args:
        database: the database of the whole store.
    """

    def __init__(self, database: Database) -> None:
        self._database = database


def chunks(numbers: Iterable[int]) -> Iterator[list[int]]:
    """Yield numbers in rising order, as many at a time as one statement may name."""
    ordered = sorted(numbers)
    for start in range(0, len(ordered), CHUNK):
        yield ordered[start : start + CHUNK]


@contextmanager
def translate_errors(backend: Backend) -> Iterator[None]:
    """Translate errors of the database in this block.

    Raises:
        StoreUnavailable: the database cannot be reached, or (StoreUnwritable) not written.
    """
    try:
        yield
    except MISTAKES:
        raise
    except (
        exc.DatabaseError,
        exc.InterfaceError,
        exc.TimeoutError,
        OSError,
        sqlite3.Error,
    ) as error:
        # The driver's error is not kept as the cause, because its text may hold the password.
        raise to_unavailable(backend, error) from None


def to_unavailable(backend: Backend, error: Exception) -> StoreUnavailable:
    """Return the error for users: the first line of the driver's message, without secrets."""
    origin = getattr(error, "orig", None) or error
    complaint = str(origin).strip()
    line = complaint.splitlines()[0] if complaint else type(error).__name__
    for secret in backend.secrets:
        line = line.replace(secret, "***")
    if backend.refuses_writes(origin):
        problem = f"The database {backend.label} cannot be written: {line.rstrip('.')}."
        return StoreUnwritable(problem, ROOM)
    kind = StoreDamaged if backend.is_damage(origin) else StoreUnavailable
    return kind(
        f"The database {backend.label} is not available: {line.rstrip('.')}.",
        backend.remedy_of(origin),
    )
