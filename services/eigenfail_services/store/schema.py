"""The tables of the store, its column types, and functions that databases write differently.

Tables and columns are named as in the glossary; times are milliseconds since 1970.
"""

from typing import Any

import sqlalchemy as sa
from sqlalchemy.ext.compiler import compiles
from sqlalchemy.sql.compiler import SQLCompiler
from sqlalchemy.sql.functions import FunctionElement
from sqlalchemy.types import TypeEngine

from eigenfail.values.campaign_spec import Priority
from eigenfail.values.episode import FAILURES, Outcome
from eigenfail.values.measures import MEASURES, Measure
from eigenfail.values.scene import PEAK_BRAKING_MPS2

VERSION = "1004"
"""The newest migration: what this program was made for."""

VERSION_TABLE = "eigenfail_schema"

metadata = sa.MetaData(
    naming_convention={
        "pk": "pk_%(table_name)s",
        "fk": "fk_%(table_name)s_%(column_0_name)s",
        "ix": "ix_%(table_name)s_%(column_0_N_name)s",
        "uq": "uq_%(table_name)s_%(column_0_N_name)s",
        "ck": "ck_%(table_name)s_%(constraint_name)s",
    }
)


LONGEST_PROSE = 4_000

MAX_NUMBER = 2**63 - 1


class Number(sa.TypeDecorator[int]):
    """An id or index from anywhere: one that no column can hold is as good as the largest."""

    impl = sa.BigInteger
    cache_ok = True

    def load_dialect_impl(self, dialect: sa.Dialect) -> TypeEngine[int]:
        """SQLite counts up by itself only in columns of type INTEGER, which hold 64 bits."""
        return sa.Integer() if dialect.name == "sqlite" else sa.BigInteger()

    def process_bind_param(self, value: int | None, _dialect: sa.Dialect) -> int | None:
        """Return a number that is clamped to 64 bits."""
        return None if value is None else max(-MAX_NUMBER, min(value, MAX_NUMBER))


def clean_prose(text: str) -> str:
    """Return a text that any database takes, at most `LONGEST_PROSE` characters long.

    Half characters and NUL are replaced, and the end is cut off.
    """
    whole = text[:LONGEST_PROSE].encode(errors="replace").decode()
    return whole.replace("\x00", "�")


class Prose(sa.TypeDecorator[str]):
    """Text from anywhere: a planner's error may hold what no database takes, at any length."""

    impl = sa.Text
    cache_ok = True

    def process_bind_param(self, value: str | None, _dialect: sa.Dialect) -> str | None:
        """Return the text without half characters and NUL, and cut off at its limit."""
        return None if value is None else clean_prose(value)


def _find_type(measure: Measure) -> TypeEngine[Any]:
    if measure.is_text:
        return Prose()
    return sa.Integer() if measure.is_count else sa.Double()


def _only(condition: str) -> dict[str, Any]:
    """Return the options of an index that holds only the rows that meet a condition."""
    return {f"{each}_where": sa.text(condition) for each in ("sqlite", "postgresql")}


campaigns = sa.Table(
    "campaigns",
    metadata,
    sa.Column("id", Number, primary_key=True),
    sa.Column("state", sa.Text, nullable=False),
    sa.Column("spec", sa.Text, nullable=False),  # JSON
    sa.Column("planned", sa.Integer, nullable=False),
    sa.Column("completed", sa.Integer, nullable=False),
    sa.Column("failures", sa.Integer, nullable=False),
    sa.Column("failed", sa.Integer, nullable=False),
    sa.Column("cancelled", sa.Integer, nullable=False),
    sa.Column("duplicates", sa.BigInteger, nullable=False),
    sa.Column("created_ms", sa.BigInteger, nullable=False),
    sa.Column("started_ms", sa.BigInteger),
    sa.Column("ended_ms", sa.BigInteger),
    sa.Column("active_s", sa.Double, nullable=False),
    sa.Column("stopped_because", Prose, nullable=False),
    sa.Column("digest", sa.Text),
    sa.Column("estimate", sa.Text),  # JSON
    sa.Column("trained_episodes", sa.Integer),
    sa.Column("learning_s", sa.Double, nullable=False),
    sa.Column("waiting_s", sa.Double, nullable=False),
    sa.Column("discarded_s", sa.Double, nullable=False),
    sa.Column("suite", Prose),
    sa.Column("priority", sa.Text, nullable=False, server_default=Priority.NORMAL),
    sa.Column("parts", sa.Text),  # JSON
    sa.Column("made_by", Number),  # id of the key; none where none was needed
    sa.Column("planner_version", Prose),  # as in the spec
    sa.Column("project", Prose),
    sa.Column("tags", sa.Text),  # JSON; none where there is none
    sa.Column("code", sa.Text),  # JSON; none where no worker has described it
    sa.Column("archived_ms", sa.BigInteger),
    sa.Column("form", sa.Text, nullable=False),  # JSON
    sa.Column("references", sa.Text, nullable=False),  # JSON
    sa.CheckConstraint("completed + failed + cancelled <= planned", name="accounted"),
    sa.Index(None, "state", "id"),
    sa.Index(None, "suite", "id"),
    sa.Index(None, "made_by", "created_ms"),
    sa.Index(None, "made_by", "ended_ms"),
    sa.Index(None, "planner_version", "id"),
    sa.Index(None, "project", "id"),
    sa.Index("ix_campaigns_versioned", "id", **_only("planner_version IS NOT NULL")),
    sqlite_autoincrement=True,
)

idempotency_keys = sa.Table(
    "idempotency_keys",
    metadata,
    sa.Column("key", sa.Text, primary_key=True),
    sa.Column("spec_hash", sa.Text, nullable=False),
    sa.Column("campaign", Number, sa.ForeignKey("campaigns.id"), nullable=False),
)

# The last two of each campaign, by number.
checkpoints = sa.Table(
    "checkpoints",
    metadata,
    sa.Column("campaign", Number, sa.ForeignKey("campaigns.id"), primary_key=True),
    sa.Column("number", sa.BigInteger, primary_key=True, autoincrement=False),
    sa.Column("saved_ms", sa.BigInteger, nullable=False),
    sa.Column("state", sa.LargeBinary, nullable=False),
    sa.Column("sha256", sa.Text, nullable=False),  # of the state
)


ENDED_COLUMNS = (
    "campaign",
    "outcome",
    "index",
    "log_probability",
    "steps",
    "severity",
    "collided_s",
    "ttc_violated_s",
    "drac_violated_s",
    "drac_at_warning_mps2",
    "peak_braking_mps2",
)
"""Columns that sums over the failures of a campaign read: one index holds all of them."""

UNRESOLVED = (
    f"final_drac_mps2 > coalesce(peak_braking_mps2, {PEAK_BRAKING_MPS2}) "
    f"AND outcome = '{Outcome.SAFE}' AND collided_s IS NULL"
)
"""Whether an episode ended when braking could no longer avoid a collision (`records.assess`).

In text: SQLite uses a partial index only for a query that has its condition without parameters.
"""

episodes = sa.Table(
    "episodes",
    metadata,
    sa.Column("campaign", Number, sa.ForeignKey("campaigns.id"), primary_key=True),
    sa.Column("index", Number, primary_key=True, autoincrement=False),
    sa.Column("seed", sa.BigInteger, nullable=False),
    sa.Column("outcome", sa.Text, nullable=False),
    sa.Column("steps", sa.Integer, nullable=False),
    sa.Column("source", Prose, nullable=False),
    sa.Column("worker", Prose, nullable=False),
    sa.Column("log_probability", sa.Double, nullable=False),
    *(sa.Column(name, _find_type(measure)) for name, measure in MEASURES.items()),
    sa.Column("wall_s", sa.Double, nullable=False),
    sa.Column("finished_ms", sa.BigInteger, nullable=False),
    sa.Column("digest", sa.Text, nullable=False),
    sa.Column("has_scene", sa.Boolean, nullable=False),
    sa.Column("fault_kind", Prose),
    sa.Column("fault_message", Prose),
    sa.Index(None, "campaign", "outcome", "min_ttc_s"),
    # These two hold all that sums over a campaign, or over its failures, are made of.
    sa.Index(
        "ix_episodes_landed",
        "campaign",
        "finished_ms",
        "index",
        "outcome",
        "robustness_m",
        "log_probability",
        "steps",
        "wall_s",
    ),
    sa.Index("ix_episodes_ended", *ENDED_COLUMNS),
    # With the outcome: without it SQLite would take the index of outcomes, and read every safe row.
    sa.Index("ix_episodes_unresolved", "campaign", "outcome", **_only(UNRESOLVED)),
    # Orders that a page of a list must not sort a million rows for.
    sa.Index(None, "campaign", "robustness_m", "index"),
    sa.Index(None, "campaign", "log_probability", "index"),
    sa.Index(None, "campaign", "severity", "index"),
    sa.Index(None, "campaign", "min_ttc_s", "index", "outcome"),
    sa.Index(None, "campaign", "max_drac_mps2", "index", "outcome"),
    sa.Index(None, "campaign", "violated", "index", **_only("violated IS NOT NULL")),
)

episode_index = episodes.c["index"]
"""The column `index` of the episodes; `episodes.c.index` is a method."""

is_unresolved: sa.ColumnElement[bool] = sa.literal_column(f"({UNRESOLVED})")

is_hopeless = sa.or_(
    episodes.c.drac_at_warning_mps2.is_(None),
    episodes.c.drac_at_warning_mps2
    > sa.func.coalesce(episodes.c.peak_braking_mps2, PEAK_BRAKING_MPS2),
)
"""Whether the brakes could not avoid a collision once it showed, if it showed at all."""

is_failure = episodes.c.outcome.in_(FAILURES)
"""Whether an episode is a failure; `~is_failure` holds for errored ones, too."""

has_no_collision = episodes.c.outcome.in_((Outcome.SAFE, Outcome.VIOLATION))
"""Whether an episode was completed and is not classed as a collision."""

# Robustness of each requirement of campaigns that name some, by its number from 1 on.
requirement_values = sa.Table(
    "requirement_values",
    metadata,
    sa.Column("campaign", Number, primary_key=True),
    sa.Column("index", Number, primary_key=True, autoincrement=False),
    sa.Column("requirement", sa.Integer, primary_key=True, autoincrement=False),
    sa.Column("robustness", sa.Double, nullable=False),
    sa.ForeignKeyConstraint(["campaign", "index"], ["episodes.campaign", "episodes.index"]),
)

# Blobs of little-endian float32, row-major: z and sigma with a column for each channel of noise,
# states with as many as `count_state` says, importance with 1.
trajectories = sa.Table(
    "trajectories",
    metadata,
    sa.Column("campaign", Number, primary_key=True),
    sa.Column("index", Number, primary_key=True, autoincrement=False),
    sa.Column("z", sa.LargeBinary, nullable=False),
    sa.Column("sigma", sa.LargeBinary, nullable=False),
    sa.Column("states", sa.LargeBinary),
    sa.Column("importance", sa.LargeBinary),
    sa.ForeignKeyConstraint(["campaign", "index"], ["episodes.campaign", "episodes.index"]),
)

scenes = sa.Table(
    "scenes",
    metadata,
    sa.Column("campaign", Number, primary_key=True),
    sa.Column("index", Number, primary_key=True, autoincrement=False),
    sa.Column("scene", sa.LargeBinary, nullable=False),  # MessagePack
    sa.ForeignKeyConstraint(["campaign", "index"], ["episodes.campaign", "episodes.index"]),
)

# What was taken away: of a campaign's safe episodes of one source, up to an index, all but each
# so-manyth.
prunings = sa.Table(
    "prunings",
    metadata,
    sa.Column("id", Number, primary_key=True),
    sa.Column("campaign", Number, sa.ForeignKey("campaigns.id"), nullable=False),
    sa.Column("source", Prose, nullable=False),
    sa.Column("keep_every", sa.BigInteger, nullable=False),
    sa.Column("through", Number, nullable=False),
    sa.Column("pruned_ms", sa.BigInteger, nullable=False),
    sa.Column("who", Prose, nullable=False),
    sa.Column("episodes", sa.BigInteger, nullable=False),
    sa.Column("scenes", sa.BigInteger, nullable=False),
    sa.Column("bytes", sa.BigInteger, nullable=False),
    sa.Index(None, "campaign", "id"),
    sqlite_autoincrement=True,
)

# Of episodes that were running as their workers were lost.
deaths = sa.Table(
    "deaths",
    metadata,
    sa.Column("campaign", Number, sa.ForeignKey("campaigns.id"), primary_key=True),
    sa.Column("index", Number, primary_key=True, autoincrement=False),
    sa.Column("workers", sa.Integer, nullable=False),
)


analyses = sa.Table(
    "analyses",
    metadata,
    sa.Column("id", Number, primary_key=True),
    sa.Column("campaign", Number, sa.ForeignKey("campaigns.id"), nullable=False),
    sa.Column("settings", sa.Text, nullable=False),  # JSON
    sa.Column("state", sa.Text, nullable=False),
    sa.Column("created_ms", sa.BigInteger, nullable=False),
    sa.Column("problem", Prose, nullable=False),
    sa.Column("failures", sa.Integer),
    sa.Column("modes", sa.Integer),
    sa.Column("silhouette", sa.Double),
    sa.Column("noise_silhouette", sa.Double),
    sa.Column("result", sa.LargeBinary),  # MessagePack
    sa.Index(None, "campaign", "id"),
    sqlite_autoincrement=True,
)

# The modes of analyses that are done, each with its name and its triage, which both are given by
# people: no digest has them.
modes = sa.Table(
    "modes",
    metadata,
    sa.Column(
        "analysis", Number, sa.ForeignKey("analyses.id"), primary_key=True, autoincrement=False
    ),
    sa.Column("number", sa.Integer, primary_key=True, autoincrement=False),  # from 1
    sa.Column("failures", sa.Integer, nullable=False),
    sa.Column("name", Prose, nullable=False),
    sa.Column("state", sa.Text, nullable=False, server_default="new"),
    sa.Column("ticket", Prose, nullable=False, server_default=""),
    sa.Column("note", Prose, nullable=False, server_default=""),
    sa.Column("changed_by", Prose, nullable=False, server_default=""),
    sa.Column("changed_ms", sa.BigInteger),
)

# The mode of each failure in each analysis of it, which may be of several campaigns.
mode_members = sa.Table(
    "mode_members",
    metadata,
    sa.Column(
        "campaign", Number, sa.ForeignKey("campaigns.id"), primary_key=True, autoincrement=False
    ),
    sa.Column(
        "analysis", Number, sa.ForeignKey("analyses.id"), primary_key=True, autoincrement=False
    ),
    sa.Column("index", Number, primary_key=True, autoincrement=False),
    sa.Column("number", sa.Integer, nullable=False),
    sa.Index(None, "analysis", "number"),
)


def select_newest_analysis(campaign: Any) -> sa.Select[int]:
    """Return the query for the newest analysis of a campaign that has a mode: its id, or NULL."""
    member = mode_members.alias().c
    return sa.select(sa.func.max(member.analysis)).where(member.campaign == campaign)


# The campaigns that replay what an analysis found.
replays = sa.Table(
    "replays",
    metadata,
    sa.Column(
        "analysis", Number, sa.ForeignKey("analyses.id"), primary_key=True, autoincrement=False
    ),
    sa.Column(
        "campaign", Number, sa.ForeignKey("campaigns.id"), primary_key=True, autoincrement=False
    ),
)


events = sa.Table(
    "events",
    metadata,
    sa.Column("id", Number, primary_key=True, autoincrement=False),
    sa.Column("at_ms", sa.BigInteger, nullable=False),
    sa.Column("kind", Prose, nullable=False),
    sa.Column("message", Prose, nullable=False),
    sa.Column("campaign", Number),
    sa.Column("subject", Number),
    sa.Column("state", sa.Text, nullable=False),
    sa.Index(None, "campaign", "id"),
)

# One row, there from the first migration on.
event_counter = sa.Table(
    "event_counter",
    metadata,
    sa.Column("id", sa.Integer, primary_key=True, autoincrement=False),
    sa.Column("last", sa.BigInteger, nullable=False),
)


jobs = sa.Table(
    "jobs",
    metadata,
    sa.Column("id", Number, primary_key=True),
    sa.Column("kind", sa.Text, nullable=False),
    sa.Column("subject", Number, nullable=False),
    sa.Column("queued_ms", sa.BigInteger, nullable=False),
    sa.Column("owner", Prose),
    sa.Column("token", sa.Text),
    sa.Column("lease_until_ms", sa.BigInteger, nullable=False),  # by the clock of leases
    sa.Column("lease_ms", sa.BigInteger, nullable=False),
    sa.Column("attempts", sa.Integer, nullable=False),
    sa.Column("progress", sa.BigInteger, nullable=False),
    sa.Column("buried_because", Prose),
    sa.UniqueConstraint("kind", "subject"),
    sqlite_autoincrement=True,
)

arrivals = sa.Table(
    "arrivals",
    metadata,
    sa.Column("id", Number, primary_key=True),
    sa.Column("worker", Prose, nullable=False),
    sa.Column("host", Prose, nullable=False),
    sa.Column("pid", sa.BigInteger, nullable=False),
    sa.Column("versions", sa.Text, nullable=False),
    sa.Column("offer", sa.Text),  # JSON; of the worker's bridge, while it is connected
    sa.Column("arrived_ms", sa.BigInteger, nullable=False),
    sa.Column("heard_ms", sa.BigInteger, nullable=False),
    sa.Column("left_ms", sa.BigInteger),
    sa.Index(None, "worker", "arrived_ms"),
    sqlite_autoincrement=True,
)


# Of a key's secret, its SHA-256 alone.
keys = sa.Table(
    "keys",
    metadata,
    sa.Column("id", Number, primary_key=True),
    sa.Column("name", Prose, nullable=False),
    sa.Column("scope", sa.Text, nullable=False),
    sa.Column("digest", sa.Text, nullable=False),
    sa.Column("created_ms", sa.BigInteger, nullable=False),
    sa.Column("expires_ms", sa.BigInteger),
    sa.Column("revoked_ms", sa.BigInteger),
    sa.Column("last_used_ms", sa.BigInteger),
    sa.Column("max_open", sa.BigInteger),
    sa.Column("max_episodes", sa.BigInteger),
    sa.Column("max_episodes_per_day", sa.BigInteger),
    sqlite_autoincrement=True,
)

audit = sa.Table(
    "audit",
    metadata,
    sa.Column("id", Number, primary_key=True),
    sa.Column("at_ms", sa.BigInteger, nullable=False),
    sa.Column("who", Prose, nullable=False),
    sa.Column("key", Number),
    sa.Column("method", Prose, nullable=False),
    sa.Column("route", Prose, nullable=False),
    sa.Column("subject", Prose, nullable=False),
    sa.Column("address", Prose, nullable=False),
    sa.Column("status", sa.Integer, nullable=False),
    sa.Column("details", Prose, nullable=False, server_default=""),
    sqlite_autoincrement=True,
)


# Reports of gates, each once: `digest` is the SHA-256 of the report without file and links.
gates = sa.Table(
    "gates",
    metadata,
    sa.Column("id", Number, primary_key=True),
    sa.Column("created_ms", sa.BigInteger, nullable=False),
    sa.Column("digest", sa.Text, nullable=False),
    sa.Column("suite", Prose, nullable=False),
    sa.Column("version", Prose, nullable=False),
    sa.Column("run", Prose, nullable=False),
    sa.Column("baseline", Prose, nullable=False),
    sa.Column("open", sa.Boolean, nullable=False),
    sa.Column("counts", sa.Text, nullable=False),  # JSON
    sa.Column("conclusion", Prose, nullable=False),
    sa.Column("report", sa.Text, nullable=False),  # JSON
    sa.UniqueConstraint("digest"),
    sqlite_autoincrement=True,
)


# Plug-ins bring tables of their own. Here are the versions of these tables, by plug-in.
plugin_versions = sa.Table(
    "plugins",
    metadata,
    sa.Column("name", sa.Text, primary_key=True),
    sa.Column("version", sa.Integer, nullable=False),
)

PLUGIN_PREFIX = "plugin_"
"""The names of all tables of plug-ins begin like this, whether or not the plug-in is installed."""


def is_own_table(name: str) -> bool:
    """Return whether a table belongs to eigenfail or to a plug-in."""
    return name in {*metadata.tables, VERSION_TABLE} or name.startswith(PLUGIN_PREFIX)


class SpecFieldExpression(FunctionElement[str]):
    """A field of a campaign's spec, which is stored as JSON; objects come out as JSON text."""

    name = "spec_field"
    type = Prose()
    inherit_cache = True


def spec_field(name: str) -> SpecFieldExpression:
    """Return a field of a campaign's spec as an SQL expression, by its name or dotted path."""
    return SpecFieldExpression(campaigns.c.spec, name)


SECONDS_PER_HOUR = 3_600.0

instance_hours = (
    campaigns.c.active_s * sa.cast(spec_field("instances"), sa.Double) / SECONDS_PER_HOUR
)
"""Time that the instances of a campaign took, as an SQL expression. [h]"""

spent_usd = instance_hours * sa.cast(spec_field("price_usd_per_hour"), sa.Double)
"""Cost of the instances of a campaign, as an SQL expression. [USD]"""


@compiles(SpecFieldExpression, "sqlite")
def _in_sqlite(element: SpecFieldExpression, compiler: SQLCompiler, **more: Any) -> str:
    spec, name = (compiler.process(part, **more) for part in element.clauses)
    return f"json_extract({spec}, '$.' || {name})"


@compiles(SpecFieldExpression, "postgresql")
def _in_postgres(element: SpecFieldExpression, compiler: SQLCompiler, **more: Any) -> str:
    spec, name = (compiler.process(part, **more) for part in element.clauses)
    return f"(CAST({spec} AS JSON) #>> string_to_array({name}, '.'))"


class PositionExpression(FunctionElement[int]):
    """Position of a text in another text, from 1, case-sensitive; 0 if it does not occur."""

    name = "position"
    type = sa.Integer()
    inherit_cache = True


@compiles(PositionExpression, "sqlite")
def _find_in_sqlite(element: PositionExpression, compiler: SQLCompiler, **more: Any) -> str:
    whole, part = (compiler.process(each, **more) for each in element.clauses)
    return f"instr({whole}, {part})"


@compiles(PositionExpression, "postgresql")
def _find_in_postgres(element: PositionExpression, compiler: SQLCompiler, **more: Any) -> str:
    whole, part = (compiler.process(each, **more) for each in element.clauses)
    return f"strpos({whole}, {part})"
