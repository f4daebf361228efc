"""The roster: which workers are connected, and which were."""

from collections.abc import Collection, Mapping, Sequence

import msgspec
from msgspec.structs import asdict
from sqlalchemy import ColumnElement, Connection, Update, delete, insert, select, update

from eigenfail.bridges import BridgeOffer
from eigenfail.values.operations import Arrival, Presence
from eigenfail_services.store.clock import now_ms
from eigenfail_services.store.codec import StructRows
from eigenfail_services.store.engine import StorePart, chunks
from eigenfail_services.store.schema import arrivals

PRESENT_S = 15
"""A worker that no hub has reported for this time is absent; hubs report every few seconds [s]."""

ABANDONED_S = 3_600
"""The offer of a worker that no hub has reported for this time is deleted [s]. The time is long,
since a hub that stood still and then goes on does not write its workers' offers again."""

KEPT_ARRIVALS = 100_000
"""Arrivals of workers; older ones are deleted."""

PRUNED_EVERY = 1_000
# A database may return ids in any order, and the caller matches them to workers by their place.
_ARRIVED = insert(arrivals).returning(arrivals.c.id, sort_by_parameter_order=True)

_ROWS = StructRows(arrivals, Presence, {"versions": msgspec.json.decode})

_offers = msgspec.json.Decoder(BridgeOffer)


class Roster(StorePart):
    """Workers that are and were connected; the newest arrivals are kept.

    Each method writes all or nothing.
    """

    def arrived(self, arrivals: Sequence[Arrival]) -> list[int]:
        """Record that workers have connected; return their ids, rising, in the same order.

        Offers of workers whose hub was killed are deleted.
        """
        if not arrivals:
            return []
        at_ms = now_ms()
        with self._database.writing() as connection:
            rows = [_row(arrival, at_ms) for arrival in arrivals]
            numbers = [*connection.execute(_ARRIVED, rows).scalars()]
            _delete_abandoned_offers(connection, at_ms)
            _prune(connection, numbers)
        return numbers

    def heard(self, presences: Collection[int]) -> None:
        """Record that workers are still connected."""
        self._note(update(arrivals).values(heard_ms=now_ms()), presences)

    def left(self, presences: Collection[int]) -> None:
        """Record that workers have disconnected; a second time changes nothing."""
        here = update(arrivals).where(arrivals.c.left_ms.is_(None))
        self._note(here.values(left_ms=now_ms(), offer=None), presences)

    def set_offers(self, offers: Mapping[int, str | None]) -> None:
        """Record what the bridges of workers offer, as JSON by presence; None for none."""
        with self._database.writing() as connection:
            for presence, offer in offers.items():
                one = update(arrivals).where(arrivals.c.id == presence)
                connection.execute(one.values(offer=offer))

    def list_offers(self) -> tuple[BridgeOffer, ...]:
        """Return the different offers of the bridges of connected workers."""
        here = _is_here(now_ms() - 1_000 * PRESENT_S)
        query = select(arrivals.c.offer).where(here, arrivals.c.offer.is_not(None))
        with self._database.reading() as connection:
            texts = connection.execute(query.distinct().order_by(arrivals.c.offer)).scalars()
            return tuple(map(_offers.decode, texts))

    def _note(self, statement: Update, presences: Collection[int]) -> None:
        with self._database.writing() as connection:
            # In portions: a fleet may have more workers than one statement takes parameters.
            for some in chunks(set(presences)):
                connection.execute(statement.where(arrivals.c.id.in_(some)))

    def present(self, since_ms: int) -> tuple[Presence, ...]:
        """Return the workers that were heard since a moment and have not left, by name."""
        query = select(*_ROWS.columns).where(_is_here(since_ms))
        query = query.order_by(arrivals.c.worker, arrivals.c.id)
        return self._database.read(_ROWS.list, query)

    def last(self, worker: str, at_ms: int) -> Presence | None:
        """Return the latest arrival under a name up to a moment, if it is still on record."""
        named = (arrivals.c.worker == worker) & (arrivals.c.arrived_ms <= at_ms)
        query = select(*_ROWS.columns).where(named).order_by(arrivals.c.id.desc()).limit(1)
        return self._database.read(_ROWS.first, query)


def _is_here(since_ms: int) -> ColumnElement[bool]:
    return (arrivals.c.heard_ms >= since_ms) & arrivals.c.left_ms.is_(None)


def _delete_abandoned_offers(connection: Connection, at_ms: int) -> None:
    abandoned = arrivals.c.heard_ms < at_ms - 1_000 * ABANDONED_S
    offered = update(arrivals).where(arrivals.c.offer.is_not(None), abandoned)
    connection.execute(offered.values(offer=None))


def _prune(connection: Connection, numbers: Sequence[int]) -> None:
    # Several workers arrive in one transaction, and the thousandth may be any of them.
    if any(number % PRUNED_EVERY == 0 for number in numbers):
        oldest = numbers[-1] - KEPT_ARRIVALS
        connection.execute(delete(arrivals).where(arrivals.c.id <= oldest))


def _row(arrival: Arrival, at_ms: int) -> dict[str, object]:
    versions = msgspec.json.encode(arrival.versions).decode()
    return asdict(arrival) | {"versions": versions, "arrived_ms": at_ms, "heard_ms": at_ms}
