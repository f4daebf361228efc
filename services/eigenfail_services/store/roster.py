"""Which workers are there, and were, in SQL."""

from collections.abc import Collection

import msgspec
from msgspec.structs import asdict
from sqlalchemy import Connection, RowMapping, Update, delete, insert, select, update

from eigenfail.values.worker import Arrival, Presence, Versions
from eigenfail_services.store import limits
from eigenfail_services.store.clock import now_ms
from eigenfail_services.store.engine import Database
from eigenfail_services.store.schema import arrivals

PRUNED_EVERY = 1_000

_versions = msgspec.json.Decoder(Versions)


class SqlRoster:
    """Keeps the newest arrivals; older ones are forgotten."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def arrived(self, arrival: Arrival) -> int:
        """A worker has come; the number under which it is there."""
        at_ms = now_ms()
        values = asdict(arrival) | {"versions": msgspec.json.encode(arrival.versions).decode()}
        statement = insert(arrivals).values(arrived_ms=at_ms, heard_ms=at_ms, **values)
        with self._database.writing() as connection:
            number: int = connection.execute(statement.returning(arrivals.c.id)).scalar_one()
            prune(connection, number)
        return number

    def heard(self, presences: Collection[int]) -> None:
        """These are still there."""
        self._note(update(arrivals).where(arrivals.c.id.in_(presences)).values(heard_ms=now_ms()))

    def left(self, presence: int) -> None:
        """It is not there any more; a second time changes nothing."""
        here = (arrivals.c.id == presence) & arrivals.c.left_ms.is_(None)
        self._note(update(arrivals).where(here).values(left_ms=now_ms()))

    def _note(self, statement: Update) -> None:
        with self._database.writing() as connection:
            connection.execute(statement)

    def present(self, since_ms: int) -> tuple[Presence, ...]:
        """Those that were heard since then and have not left, by name."""
        here = (arrivals.c.heard_ms >= since_ms) & arrivals.c.left_ms.is_(None)
        query = select(arrivals).where(here).order_by(arrivals.c.worker, arrivals.c.id)
        with self._database.reading() as connection:
            return tuple(map(_presence, connection.execute(query).mappings()))

    def last(self, worker: str, at_ms: int) -> Presence | None:
        """The latest arrival under a name up to a moment, if it is still known."""
        named = (arrivals.c.worker == worker) & (arrivals.c.arrived_ms <= at_ms)
        query = select(arrivals).where(named).order_by(arrivals.c.id.desc()).limit(1)
        with self._database.reading() as connection:
            found = connection.execute(query).mappings().first()
        return None if found is None else _presence(found)


def prune(connection: Connection, number: int) -> None:
    """Forget what is too old, now and then."""
    if number % PRUNED_EVERY == 0:
        oldest = number - limits.KEPT_ARRIVALS
        connection.execute(delete(arrivals).where(arrivals.c.id <= oldest))


def _presence(found: RowMapping) -> Presence:
    values = dict(found)
    return Presence(versions=_versions.decode(values.pop("versions")), **values)
