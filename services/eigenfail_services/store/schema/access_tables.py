"""Keys, and what was done with them."""

from sqlalchemy import BigInteger, Column, Integer, Table, Text

from eigenfail_services.store.schema.base import metadata
from eigenfail_services.store.schema.column_types import Number, Prose

# Of a key's secret, its SHA-256 alone.
keys = Table(
    "keys",
    metadata,
    Column("id", Number, primary_key=True),
    Column("name", Prose, nullable=False),
    Column("scope", Text, nullable=False),
    Column("digest", Text, nullable=False),
    Column("created_ms", BigInteger, nullable=False),
    Column("expires_ms", BigInteger),
    Column("revoked_ms", BigInteger),
    Column("last_used_ms", BigInteger),
    Column("max_open", BigInteger),
    Column("max_episodes", BigInteger),
    Column("max_episodes_per_day", BigInteger),
    sqlite_autoincrement=True,
)

audit = Table(
    "audit",
    metadata,
    Column("id", Number, primary_key=True),
    Column("at_ms", BigInteger, nullable=False),
    Column("who", Prose, nullable=False),
    Column("key", Number),
    Column("method", Prose, nullable=False),
    Column("route", Prose, nullable=False),
    Column("subject", Prose, nullable=False),
    Column("address", Prose, nullable=False),
    Column("status", Integer, nullable=False),
    sqlite_autoincrement=True,
)
