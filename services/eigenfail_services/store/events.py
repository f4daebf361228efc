"""The event log.

Readers ask for ids above the last one seen, so an id must never become visible after a higher one.
Ids therefore come from one counted row: it stays locked from the moment an id is taken until that
transaction's end, and ids appear in order, without gaps. Every transaction takes an id last, so
that transactions do not wait for long, and never for each other.
"""

from collections.abc import Collection
from typing import NamedTuple

import msgspec
from sqlalchemy import Connection, delete, insert, select, update

from eigenfail.values.campaign import CampaignState
from eigenfail.values.operations import Event
from eigenfail_services.store.clock import now_ms
from eigenfail_services.store.codec import StructRows
from eigenfail_services.store.engine import StorePart
from eigenfail_services.store.schema import campaigns, event_counter, events

KEPT_EVENTS = 200_000
"""Events in the log; older ones are deleted."""

# Old events are deleted with every thousandth event: with each one, every writer would wait for a
# further statement under the lock of the counter.
PRUNED_EVERY = 1_000


class EventSubject(NamedTuple):
    """The subject of an event, besides a campaign: see `Event`."""

    id: int | None = None
    state: str = ""


NO_SUBJECT = EventSubject()


def append_event(
    connection: Connection,
    kind: str,
    message: str,
    campaign: int | None = None,
    subject: EventSubject = NO_SUBJECT,
) -> Event:
    """Log an event; this must be the last statement of a transaction."""
    number = connection.execute(
        update(event_counter).values(last=event_counter.c.last + 1).returning(event_counter.c.last)
    ).scalar_one()
    event = Event(number, now_ms(), kind, message, campaign, subject.id, subject.state)
    connection.execute(insert(events).values(**msgspec.structs.asdict(event)))
    if number % PRUNED_EVERY == 0:
        connection.execute(delete(events).where(events.c.id <= number - KEPT_EVENTS))
    return event


_ROWS = StructRows(events, Event)


class EventLog(StorePart):
    """The newest events, in order; older ones are deleted."""

    def append(self, kind: str, message: str, campaign: int | None = None) -> Event:
        """Log an event."""
        with self._database.writing() as connection:
            return append_event(connection, kind, message, campaign)

    def after(self, event: int, limit: int, campaign: int | None = None) -> list[Event]:
        """Return events with ids above `event`, oldest first.

        A reader that keeps the id of the last event it has read misses no later event, and reads
        events in order. See the top of this module.
        """
        query = select(events).where(events.c.id > event).order_by(events.c.id).limit(limit)
        if campaign is not None:
            query = query.where(events.c.campaign == campaign)
        return [*self._database.read(_ROWS.list, query)]

    def latest(self, limit: int, campaign: int | None = None) -> list[Event]:
        """Return the newest events, newest first."""
        query = select(events).order_by(events.c.id.desc()).limit(limit)
        if campaign is not None:
            query = query.where(events.c.campaign == campaign)
        return [*self._database.read(_ROWS.list, query)]

    def newest(self, kinds: Collection[str]) -> list[Event]:
        """Return the newest event of the given kinds for each running campaign, by campaign."""
        # The index by campaign and id answers this with one step for each campaign; a grouping
        # would read all events of these kinds.
        newest = (
            select(events.c.id)
            .where(events.c.campaign == campaigns.c.id, events.c.kind.in_(kinds))
            .order_by(events.c.id.desc())
            .limit(1)
            .correlate(campaigns)
        )
        ids = select(newest.scalar_subquery()).where(campaigns.c.state == CampaignState.RUNNING)
        query = select(events).where(events.c.id.in_(ids)).order_by(events.c.campaign)
        return [*self._database.read(_ROWS.list, query)]

    def last(self) -> int:
        """Return the id of the newest event, or 0."""
        with self._database.reading() as connection:
            last: int = connection.execute(select(event_counter.c.last)).scalar_one()
        return last
