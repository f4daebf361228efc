"""Jobs for supervisors, and the workers that came."""

from sqlalchemy import BigInteger, Column, Index, Integer, Table, Text, UniqueConstraint

from eigenfail_services.store.schema.base import metadata
from eigenfail_services.store.schema.column_types import Number, Prose

jobs = Table(
    "jobs",
    metadata,
    Column("id", Number, primary_key=True),
    Column("kind", Text, nullable=False),
    Column("subject", Number, nullable=False),
    Column("queued_ms", BigInteger, nullable=False),
    Column("owner", Prose),
    Column("token", Text),
    Column("lease_until_ms", BigInteger, nullable=False),  # by the clock of leases
    Column("lease_ms", BigInteger, nullable=False),
    Column("attempts", Integer, nullable=False),
    Column("progress", BigInteger, nullable=False),
    Column("buried_because", Prose),
    UniqueConstraint("kind", "subject"),
    sqlite_autoincrement=True,
)

arrivals = Table(
    "arrivals",
    metadata,
    Column("id", Number, primary_key=True),
    Column("worker", Prose, nullable=False),
    Column("host", Prose, nullable=False),
    Column("pid", BigInteger, nullable=False),
    Column("versions", Text, nullable=False),
    Column("arrived_ms", BigInteger, nullable=False),
    Column("heard_ms", BigInteger, nullable=False),
    Column("left_ms", BigInteger),
    Index(None, "worker", "arrived_ms"),
    sqlite_autoincrement=True,
)
