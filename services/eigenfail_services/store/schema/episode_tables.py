"""Episodes, what is kept of each, and what was taken away."""

from sqlalchemy import (
    BigInteger,
    Boolean,
    Column,
    Double,
    ForeignKey,
    ForeignKeyConstraint,
    Index,
    Integer,
    LargeBinary,
    Table,
    Text,
)

from eigenfail_services.store.schema.base import metadata
from eigenfail_services.store.schema.column_types import Number, Prose

episodes = Table(
    "episodes",
    metadata,
    Column("campaign", Number, ForeignKey("campaigns.id"), primary_key=True),
    Column("index", Number, primary_key=True, autoincrement=False),
    Column("seed", BigInteger, nullable=False),
    Column("outcome", Text, nullable=False),
    Column("steps", Integer, nullable=False),
    Column("source", Prose, nullable=False),
    Column("worker", Prose, nullable=False),
    Column("robustness_m", Double),
    Column("log_probability", Double, nullable=False),
    Column("severity", Double),
    Column("min_ttc_s", Double),
    Column("max_drac_mps2", Double),
    Column("ttc_violated_s", Double),
    Column("drac_violated_s", Double),
    Column("drac_at_warning_mps2", Double),
    Column("collided_s", Double),
    Column("left_road_s", Double),
    Column("max_jerk_mps3", Double),
    Column("hard_brakings", Integer),
    Column("clipped_steps", Integer),
    Column("final_drac_mps2", Double),
    Column("wall_s", Double, nullable=False),
    Column("finished_ms", BigInteger, nullable=False),
    Column("digest", Text, nullable=False),
    Column("has_scene", Boolean, nullable=False),
    Column("fault_kind", Prose),
    Column("fault_message", Prose),
    Index(None, "campaign", "outcome", "min_ttc_s"),
    # These two hold all that sums over a campaign, or over its failures, are made of.
    Index(
        "ix_episodes_landed",
        *("campaign", "finished_ms", "index", "outcome", "robustness_m", "log_probability"),
        *("steps", "wall_s"),
    ),
    Index(
        "ix_episodes_ended",
        *("campaign", "outcome", "index", "log_probability", "steps", "severity", "collided_s"),
        *("ttc_violated_s", "drac_violated_s", "drac_at_warning_mps2"),
    ),
    # Orders that a page of a list must not sort a million rows for.
    Index(None, "campaign", "robustness_m", "index"),
    Index(None, "campaign", "log_probability", "index"),
    Index(None, "campaign", "severity", "index"),
    Index(None, "campaign", "min_ttc_s", "index", "outcome"),
    Index(None, "campaign", "max_drac_mps2", "index", "outcome"),
)

# Blobs of little-endian float32, row-major: z and sigma with 2 columns, states with len(STATE).
trajectories = Table(
    "trajectories",
    metadata,
    Column("campaign", Number, primary_key=True),
    Column("index", Number, primary_key=True, autoincrement=False),
    Column("z", LargeBinary, nullable=False),
    Column("sigma", LargeBinary, nullable=False),
    Column("states", LargeBinary),
    ForeignKeyConstraint(["campaign", "index"], ["episodes.campaign", "episodes.index"]),
)

scenes = Table(
    "scenes",
    metadata,
    Column("campaign", Number, primary_key=True),
    Column("index", Number, primary_key=True, autoincrement=False),
    Column("scene", LargeBinary, nullable=False),  # MessagePack
    ForeignKeyConstraint(["campaign", "index"], ["episodes.campaign", "episodes.index"]),
)

# What was taken away: of a campaign's safe episodes of one source, up to an index, all but each
# so-manyth.
prunings = Table(
    "prunings",
    metadata,
    Column("id", Number, primary_key=True),
    Column("campaign", Number, ForeignKey("campaigns.id"), nullable=False),
    Column("source", Prose, nullable=False),
    Column("keep_every", BigInteger, nullable=False),
    Column("through", Number, nullable=False),
    Column("pruned_ms", BigInteger, nullable=False),
    Column("who", Prose, nullable=False),
    Column("episodes", BigInteger, nullable=False),
    Column("scenes", BigInteger, nullable=False),
    Column("bytes", BigInteger, nullable=False),
    Index(None, "campaign", "id"),
    sqlite_autoincrement=True,
)

# Of episodes that were running as their workers were lost.
deaths = Table(
    "deaths",
    metadata,
    Column("campaign", Number, ForeignKey("campaigns.id"), primary_key=True),
    Column("index", Number, primary_key=True, autoincrement=False),
    Column("workers", Integer, nullable=False),
)
