"""Analyses, and the campaigns that replay what they found."""

from sqlalchemy import (
    BigInteger,
    Column,
    Double,
    ForeignKey,
    Index,
    Integer,
    LargeBinary,
    Table,
    Text,
)

from eigenfail_services.store.schema.base import metadata
from eigenfail_services.store.schema.column_types import Number, Prose

analyses = Table(
    "analyses",
    metadata,
    Column("id", Number, primary_key=True),
    Column("campaign", Number, ForeignKey("campaigns.id"), nullable=False),
    Column("settings", Text, nullable=False),  # JSON
    Column("state", Text, nullable=False),
    Column("created_ms", BigInteger, nullable=False),
    Column("problem", Prose, nullable=False),
    Column("failures", Integer),
    Column("modes", Integer),
    Column("silhouette", Double),
    Column("noise_silhouette", Double),
    Column("result", LargeBinary),  # MessagePack
    Index(None, "campaign", "id"),
    sqlite_autoincrement=True,
)

# The campaigns that replay what an analysis found.
replays = Table(
    "replays",
    metadata,
    Column("analysis", Number, ForeignKey("analyses.id"), primary_key=True, autoincrement=False),
    Column("campaign", Number, ForeignKey("campaigns.id"), primary_key=True, autoincrement=False),
)
