"""What happened."""

from sqlalchemy import BigInteger, Column, Index, Integer, Table

from eigenfail_services.store.schema.base import metadata
from eigenfail_services.store.schema.column_types import Number, Prose

events = Table(
    "events",
    metadata,
    Column("id", Number, primary_key=True, autoincrement=False),
    Column("at_ms", BigInteger, nullable=False),
    Column("kind", Prose, nullable=False),
    Column("message", Prose, nullable=False),
    Column("campaign", Number),
    Index(None, "campaign", "id"),
)

# One row, there from the first migration on.
event_counter = Table(
    "event_counter",
    metadata,
    Column("id", Integer, primary_key=True, autoincrement=False),
    Column("last", BigInteger, nullable=False),
)
