"""The event log in SQL.

Whoever follows the log asks for ids above the last one seen, so an id must never become visible
after a higher one. Ids therefore come from one counted row: it stays locked from the moment an id
is taken until that transaction's end, and ids appear in order, without gaps. Every transaction
takes it last, so that nobody waits for long, and no two wait for each other.
"""

from collections.abc import Collection

from sqlalchemy import Connection, delete, insert, select, update

from eigenfail.values import CampaignState, Event
from eigenfail_services.store import limits
from eigenfail_services.store.clock import now_ms
from eigenfail_services.store.engine import Database
from eigenfail_services.store.schema import campaigns, event_counter, events

PRUNED_EVERY = 1_000


def append(connection: Connection, kind: str, message: str, campaign: int | None = None) -> Event:
    """Log an event as the last thing that a transaction does."""
    number = connection.execute(
        update(event_counter).values(last=event_counter.c.last + 1).returning(event_counter.c.last)
    ).scalar_one()
    event = Event(number, now_ms(), kind, message, campaign)
    connection.execute(
        insert(events).values(
            id=event.id, at_ms=event.at_ms, kind=kind, message=message, campaign=campaign
        )
    )
    if number % PRUNED_EVERY == 0:
        connection.execute(delete(events).where(events.c.id <= number - limits.KEPT_EVENTS))
    return event


class SqlEventLog:
    """Keeps the newest events; older ones are forgotten."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def append(self, kind: str, message: str, campaign: int | None = None) -> Event:
        """Log an event."""
        with self._database.writing() as connection:
            return append(connection, kind, message, campaign)

    def after(self, event: int, limit: int, campaign: int | None = None) -> list[Event]:
        """Events with ids above `event`, oldest first."""
        query = select(events).where(events.c.id > event).order_by(events.c.id).limit(limit)
        if campaign is not None:
            query = query.where(events.c.campaign == campaign)
        with self._database.reading() as connection:
            return [Event(**found) for found in connection.execute(query).mappings()]

    def latest(self, limit: int, campaign: int | None = None) -> list[Event]:
        """The newest events, newest first."""
        query = select(events).order_by(events.c.id.desc()).limit(limit)
        if campaign is not None:
            query = query.where(events.c.campaign == campaign)
        with self._database.reading() as connection:
            return [Event(**found) for found in connection.execute(query).mappings()]

    def newest(self, kinds: Collection[str]) -> list[Event]:
        """The newest event of these kinds of each campaign that is running, by campaign."""
        newest = (
            select(events.c.id)
            .where(events.c.campaign == campaigns.c.id, events.c.kind.in_(kinds))
            .order_by(events.c.id.desc())
            .limit(1)
            .correlate(campaigns)
        )
        ids = select(newest.scalar_subquery()).where(campaigns.c.state == CampaignState.RUNNING)
        query = select(events).where(events.c.id.in_(ids)).order_by(events.c.campaign)
        with self._database.reading() as connection:
            return [Event(**found) for found in connection.execute(query).mappings()]

    def last(self) -> int:
        """The id of the newest event, 0 if there is none."""
        with self._database.reading() as connection:
            last: int = connection.execute(select(event_counter.c.last)).scalar_one()
        return last
