"""Campaigns, and what their learners go on from."""

from sqlalchemy import (
    BigInteger,
    CheckConstraint,
    Column,
    Double,
    ForeignKey,
    Index,
    Integer,
    LargeBinary,
    Table,
    Text,
)

from eigenfail.values import Priority
from eigenfail_services.store.schema.base import metadata
from eigenfail_services.store.schema.column_types import Number, Prose

campaigns = Table(
    "campaigns",
    metadata,
    Column("id", Number, primary_key=True),
    Column("state", Text, nullable=False),
    Column("spec", Text, nullable=False),  # JSON
    Column("planned", Integer, nullable=False),
    Column("completed", Integer, nullable=False),
    Column("failures", Integer, nullable=False),
    Column("failed", Integer, nullable=False),
    Column("cancelled", Integer, nullable=False),
    Column("duplicates", BigInteger, nullable=False),
    Column("created_ms", BigInteger, nullable=False),
    Column("started_ms", BigInteger),
    Column("ended_ms", BigInteger),
    Column("active_s", Double, nullable=False),
    Column("stopped_because", Prose, nullable=False),
    Column("digest", Text),
    Column("estimate", Text),  # JSON
    Column("trained_episodes", Integer),
    Column("learning_s", Double),
    Column("waiting_s", Double),
    Column("discarded_s", Double),
    Column("suite", Prose),
    Column("priority", Text, nullable=False, server_default=Priority.NORMAL),
    Column("made_by", Number),  # id of the key; none where none was needed
    CheckConstraint("completed + failed + cancelled <= planned", name="accounted"),
    Index(None, "state", "id"),
    Index(None, "suite", "id"),
    Index(None, "made_by", "created_ms"),
    Index(None, "made_by", "ended_ms"),
    sqlite_autoincrement=True,
)

idempotency_keys = Table(
    "idempotency_keys",
    metadata,
    Column("key", Text, primary_key=True),
    Column("spec_hash", Text, nullable=False),
    Column("campaign", Number, ForeignKey("campaigns.id"), nullable=False),
)

# The last two of each campaign, by number.
checkpoints = Table(
    "checkpoints",
    metadata,
    Column("campaign", Number, ForeignKey("campaigns.id"), primary_key=True),
    Column("number", BigInteger, primary_key=True, autoincrement=False),
    Column("saved_ms", BigInteger, nullable=False),
    Column("state", LargeBinary, nullable=False),
    Column("sha256", Text),  # of the state; an older release kept none
)
