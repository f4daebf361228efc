"""The tables of the store, its column types, and functions that databases write differently.

Names of tables and columns are those of the glossary; times are milliseconds since 1970.
"""

from typing import Any

from sqlalchemy import (
    BigInteger,
    Boolean,
    CheckConstraint,
    Column,
    Dialect,
    Double,
    ForeignKey,
    ForeignKeyConstraint,
    Index,
    Integer,
    LargeBinary,
    MetaData,
    Select,
    Table,
    Text,
    TypeDecorator,
    UniqueConstraint,
    cast,
    func,
    select,
    text,
)
from sqlalchemy.ext.compiler import compiles
from sqlalchemy.sql.compiler import SQLCompiler
from sqlalchemy.sql.functions import FunctionElement
from sqlalchemy.types import TypeEngine

from eigenfail.values import MEASURES, Measure, Priority
from eigenfail.values.episode import FAILURES, Outcome

VERSION = "1000"
"""The newest migration: what this program was made for."""

VERSION_TABLE = "eigenfail_schema"

metadata = MetaData(
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


class Number(TypeDecorator[int]):
    """An id or index from anywhere: one that no column can hold is as good as the largest."""

    impl = BigInteger
    cache_ok = True

    def load_dialect_impl(self, dialect: Dialect) -> TypeEngine[int]:
        """SQLite counts up by itself only in columns of type INTEGER, which hold 64 bits."""
        return Integer() if dialect.name == "sqlite" else BigInteger()

    def process_bind_param(self, value: int | None, _dialect: Dialect) -> int | None:
        """Within 64 bits."""
        return None if value is None else max(-MAX_NUMBER, min(value, MAX_NUMBER))


def clean_prose(text: str) -> str:
    """Return a text that any database takes, at most `LONGEST_PROSE` characters long.

    Half characters and NUL are replaced, and the end is cut off.
    """
    whole = text[:LONGEST_PROSE].encode(errors="replace").decode()
    return whole.replace("\x00", "�")


class Prose(TypeDecorator[str]):
    """Text from anywhere: a planner's error may hold what no database takes, at any length."""

    impl = Text
    cache_ok = True

    def process_bind_param(self, value: str | None, _dialect: Dialect) -> str | None:
        """Half characters and NUL are replaced, and the end is cut off."""
        return None if value is None else clean_prose(value)


def _find_type(measure: Measure) -> TypeEngine[Any]:
    if measure.is_text:
        return Prose()
    return Integer() if measure.is_count else Double()


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
    Column("parts", Text),  # JSON
    Column("made_by", Number),  # id of the key; none where none was needed
    Column("planner_version", Prose),  # as in the spec
    Column("project", Prose),
    Column("tags", Text),  # JSON; none where there is none
    Column("code", Text),  # JSON; none where no worker has described it
    Column("archived_ms", BigInteger),
    CheckConstraint("completed + failed + cancelled <= planned", name="accounted"),
    Index(None, "state", "id"),
    Index(None, "suite", "id"),
    Index(None, "made_by", "created_ms"),
    Index(None, "made_by", "ended_ms"),
    Index(None, "planner_version", "id"),
    Index(None, "project", "id"),
    Index(
        "ix_campaigns_versioned",
        "id",
        sqlite_where=text("planner_version IS NOT NULL"),
        postgresql_where=text("planner_version IS NOT NULL"),
    ),
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
    Column("sha256", Text),  # of the state
)


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
    Column("log_probability", Double, nullable=False),
    *(Column(name, _find_type(measure)) for name, measure in MEASURES.items()),
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
        "campaign",
        "finished_ms",
        "index",
        "outcome",
        "robustness_m",
        "log_probability",
        "steps",
        "wall_s",
    ),
    Index(
        "ix_episodes_ended",
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
    ),
    # Orders that a page of a list must not sort a million rows for.
    Index(None, "campaign", "robustness_m", "index"),
    Index(None, "campaign", "log_probability", "index"),
    Index(None, "campaign", "severity", "index"),
    Index(None, "campaign", "min_ttc_s", "index", "outcome"),
    Index(None, "campaign", "max_drac_mps2", "index", "outcome"),
    Index(
        None,
        "campaign",
        "violated",
        "index",
        sqlite_where=text("violated IS NOT NULL"),
        postgresql_where=text("violated IS NOT NULL"),
    ),
)

episode_index = episodes.c["index"]
"""The column `index` of the episodes; `episodes.c.index` is a method."""

is_failure = episodes.c.outcome.in_(FAILURES)
"""Whether an episode is a failure; `~is_failure` holds for errored ones, too."""

has_no_collision = episodes.c.outcome.in_((Outcome.SAFE, Outcome.VIOLATION))
"""Whether an episode was completed and is not classed as a collision."""

# Robustness of each requirement of campaigns that name some, by its number from 1 on.
requirement_values = Table(
    "requirement_values",
    metadata,
    Column("campaign", Number, primary_key=True),
    Column("index", Number, primary_key=True, autoincrement=False),
    Column("requirement", Integer, primary_key=True, autoincrement=False),
    Column("robustness", Double, nullable=False),
    ForeignKeyConstraint(["campaign", "index"], ["episodes.campaign", "episodes.index"]),
)

# Blobs of little-endian float32, row-major: z and sigma with a column for each channel of noise,
# states with as many as `count_state` says, importance with 1.
trajectories = Table(
    "trajectories",
    metadata,
    Column("campaign", Number, primary_key=True),
    Column("index", Number, primary_key=True, autoincrement=False),
    Column("z", LargeBinary, nullable=False),
    Column("sigma", LargeBinary, nullable=False),
    Column("states", LargeBinary),
    Column("importance", LargeBinary),
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

# The modes of analyses that are done, each with its name and its triage, which both are given by
# people: no digest has them.
modes = Table(
    "modes",
    metadata,
    Column("analysis", Number, ForeignKey("analyses.id"), primary_key=True, autoincrement=False),
    Column("number", Integer, primary_key=True, autoincrement=False),  # from 1
    Column("failures", Integer, nullable=False),
    Column("name", Prose, nullable=False),
    Column("state", Text, nullable=False, server_default="new"),
    Column("ticket", Prose, nullable=False, server_default=""),
    Column("note", Prose, nullable=False, server_default=""),
    Column("changed_by", Prose, nullable=False, server_default=""),
    Column("changed_ms", BigInteger),
)

# The mode of each failure in each analysis of it, which may be of several campaigns.
mode_members = Table(
    "mode_members",
    metadata,
    Column("campaign", Number, ForeignKey("campaigns.id"), primary_key=True, autoincrement=False),
    Column("analysis", Number, ForeignKey("analyses.id"), primary_key=True, autoincrement=False),
    Column("index", Number, primary_key=True, autoincrement=False),
    Column("number", Integer, nullable=False),
    Index(None, "analysis", "number"),
)


def select_newest_analysis(campaign: Any) -> Select[int]:
    """Return the query for the newest analysis of a campaign that has a mode: its id, or NULL."""
    member = mode_members.alias().c
    return select(func.max(member.analysis)).where(member.campaign == campaign)


# The campaigns that replay what an analysis found.
replays = Table(
    "replays",
    metadata,
    Column("analysis", Number, ForeignKey("analyses.id"), primary_key=True, autoincrement=False),
    Column("campaign", Number, ForeignKey("campaigns.id"), primary_key=True, autoincrement=False),
)


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
    Column("offer", Text),  # JSON; of the worker's bridge, while it is connected
    Column("arrived_ms", BigInteger, nullable=False),
    Column("heard_ms", BigInteger, nullable=False),
    Column("left_ms", BigInteger),
    Index(None, "worker", "arrived_ms"),
    sqlite_autoincrement=True,
)


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
    Column("details", Prose, nullable=False, server_default=""),
    sqlite_autoincrement=True,
)


# A webhook's secret signs what is sent to it: a digest of it could not.
webhooks = Table(
    "webhooks",
    metadata,
    Column("id", Number, primary_key=True),
    Column("url", Text, nullable=False),
    Column("events", Text, nullable=False),  # JSON
    Column("secret", Text, nullable=False),
    Column("active", Boolean, nullable=False),
    Column("created_ms", BigInteger, nullable=False),
    sqlite_autoincrement=True,
)

# The outbox: a row for each event and webhook, of the transaction that the event is about.
webhook_deliveries = Table(
    "webhook_deliveries",
    metadata,
    Column("id", Number, primary_key=True),
    Column("webhook", Number, ForeignKey("webhooks.id"), nullable=False),
    Column("event", Text, nullable=False),
    Column("kind", Text, nullable=False),
    Column("payload", Text, nullable=False),  # JSON, as it is sent
    Column("created_ms", BigInteger, nullable=False),
    Column("state", Text, nullable=False),
    Column("attempts", Integer, nullable=False),
    Column("next_ms", BigInteger, nullable=False),
    Column("status", Integer),
    Column("problem", Prose, nullable=False),
    Column("token", Text),
    Column("lease_until_ms", BigInteger, nullable=False),  # by the clock of leases
    Column("lease_ms", BigInteger, nullable=False),
    Index(None, "state", "next_ms"),
    Index(None, "webhook", "id"),
    sqlite_autoincrement=True,
)

# Reports of gates, each once: `digest` is the SHA-256 of the report without file, links and modes
# over releases.
gates = Table(
    "gates",
    metadata,
    Column("id", Number, primary_key=True),
    Column("created_ms", BigInteger, nullable=False),
    Column("digest", Text, nullable=False),
    Column("suite", Prose, nullable=False),
    Column("version", Prose, nullable=False),
    Column("run", Prose, nullable=False),
    Column("baseline", Prose, nullable=False),
    Column("open", Boolean, nullable=False),
    Column("counts", Text, nullable=False),  # JSON
    Column("conclusion", Prose, nullable=False),
    Column("report", Text, nullable=False),  # JSON
    UniqueConstraint("digest"),
    sqlite_autoincrement=True,
)


class SpecFieldExpression(FunctionElement[str]):
    """A field of a campaign's spec, which is stored as JSON; objects come out as JSON text."""

    name = "spec_field"
    type = Prose()
    inherit_cache = True


def spec_field(name: str) -> SpecFieldExpression:
    """Return a field of a campaign's spec as an SQL expression, by its name or dotted path."""
    return SpecFieldExpression(campaigns.c.spec, name)


SECONDS_PER_HOUR = 3_600.0

instance_hours = campaigns.c.active_s * cast(spec_field("instances"), Double) / SECONDS_PER_HOUR
"""Time that the instances of a campaign took, as an SQL expression. [h]"""

spent_usd = instance_hours * cast(spec_field("price_usd_per_hour"), Double)
"""What they cost. [USD]"""


@compiles(SpecFieldExpression, "sqlite")
def _in_sqlite(element: SpecFieldExpression, compiler: SQLCompiler, **more: Any) -> str:
    spec, name = (compiler.process(part, **more) for part in element.clauses)
    return f"json_extract({spec}, '$.' || {name})"


@compiles(SpecFieldExpression, "postgresql")
def _in_postgres(element: SpecFieldExpression, compiler: SQLCompiler, **more: Any) -> str:
    spec, name = (compiler.process(part, **more) for part in element.clauses)
    return f"(CAST({spec} AS JSON) #>> string_to_array({name}, '.'))"


class PositionExpression(FunctionElement[int]):
    """Place of a text in another one, from 1, with case; 0 if it is not in it."""

    name = "position"
    type = Integer()
    inherit_cache = True


@compiles(PositionExpression, "sqlite")
def _find_in_sqlite(element: PositionExpression, compiler: SQLCompiler, **more: Any) -> str:
    text, part = (compiler.process(each, **more) for each in element.clauses)
    return f"instr({text}, {part})"


@compiles(PositionExpression, "postgresql")
def _find_in_postgres(element: PositionExpression, compiler: SQLCompiler, **more: Any) -> str:
    text, part = (compiler.process(each, **more) for each in element.clauses)
    return f"strpos({text}, {part})"
