"""The first schema."""

import sqlalchemy as sa
from alembic import op

revision = "0001"
down_revision = None
branch_labels = None
depends_on = None

ID = sa.BigInteger().with_variant(sa.Integer(), "sqlite")


def upgrade() -> None:
    create_campaigns()
    create_idempotency_keys()
    create_episodes()
    create_trajectories()
    create_scenes()
    create_checkpoints()
    create_analyses()
    create_events()
    create_jobs()


def downgrade() -> None:
    for table in (
        "jobs",
        "event_counter",
        "events",
        "analyses",
        "checkpoints",
        "scenes",
        "trajectories",
        "episodes",
        "idempotency_keys",
        "campaigns",
    ):
        op.drop_table(table)


def create_campaigns() -> None:
    op.create_table(
        "campaigns",
        sa.Column("id", ID, nullable=False),
        sa.Column("state", sa.Text(), nullable=False),
        sa.Column("spec", sa.Text(), nullable=False),
        sa.Column("planned", sa.Integer(), nullable=False),
        sa.Column("completed", sa.Integer(), nullable=False),
        sa.Column("failures", sa.Integer(), nullable=False),
        sa.Column("failed", sa.Integer(), nullable=False),
        sa.Column("cancelled", sa.Integer(), nullable=False),
        sa.Column("duplicates", sa.BigInteger(), nullable=False),
        sa.Column("created_ms", sa.BigInteger(), nullable=False),
        sa.Column("started_ms", sa.BigInteger()),
        sa.Column("ended_ms", sa.BigInteger()),
        sa.Column("active_s", sa.Double(), nullable=False),
        sa.Column("stopped_because", sa.Text(), nullable=False),
        sa.Column("digest", sa.Text()),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_campaigns")),
        sa.CheckConstraint(
            "completed + failed + cancelled <= planned", name=op.f("ck_campaigns_accounted")
        ),
        sqlite_autoincrement=True,
    )
    op.create_index(op.f("ix_campaigns_state_id"), "campaigns", ["state", "id"])


def create_idempotency_keys() -> None:
    op.create_table(
        "idempotency_keys",
        sa.Column("key", sa.Text(), nullable=False),
        sa.Column("spec_hash", sa.Text(), nullable=False),
        sa.Column("campaign", ID, nullable=False),
        sa.PrimaryKeyConstraint("key", name=op.f("pk_idempotency_keys")),
        sa.ForeignKeyConstraint(
            ["campaign"], ["campaigns.id"], name=op.f("fk_idempotency_keys_campaign")
        ),
    )


def create_episodes() -> None:
    op.create_table(
        "episodes",
        sa.Column("campaign", ID, nullable=False),
        sa.Column("index", ID, autoincrement=False, nullable=False),
        sa.Column("seed", sa.BigInteger(), nullable=False),
        sa.Column("outcome", sa.Text(), nullable=False),
        sa.Column("steps", sa.Integer(), nullable=False),
        sa.Column("source", sa.Text(), nullable=False),
        sa.Column("worker", sa.Text(), nullable=False),
        sa.Column("robustness_m", sa.Double()),
        sa.Column("log_probability", sa.Double(), nullable=False),
        sa.Column("severity", sa.Double()),
        sa.Column("min_ttc_s", sa.Double()),
        sa.Column("max_drac_mps2", sa.Double()),
        sa.Column("wall_s", sa.Double(), nullable=False),
        sa.Column("finished_ms", sa.BigInteger(), nullable=False),
        sa.Column("digest", sa.Text(), nullable=False),
        sa.Column("has_scene", sa.Boolean(), nullable=False),
        sa.Column("fault_kind", sa.Text()),
        sa.Column("fault_message", sa.Text()),
        sa.PrimaryKeyConstraint("campaign", "index", name=op.f("pk_episodes")),
        sa.ForeignKeyConstraint(["campaign"], ["campaigns.id"], name=op.f("fk_episodes_campaign")),
    )
    op.create_index(
        op.f("ix_episodes_campaign_outcome_index"), "episodes", ["campaign", "outcome", "index"]
    )


def create_trajectories() -> None:
    op.create_table(
        "trajectories",
        sa.Column("campaign", ID, nullable=False),
        sa.Column("index", ID, autoincrement=False, nullable=False),
        sa.Column("z", sa.LargeBinary(), nullable=False),
        sa.Column("sigma", sa.LargeBinary(), nullable=False),
        sa.Column("states", sa.LargeBinary()),
        sa.PrimaryKeyConstraint("campaign", "index", name=op.f("pk_trajectories")),
        sa.ForeignKeyConstraint(
            ["campaign", "index"],
            ["episodes.campaign", "episodes.index"],
            name=op.f("fk_trajectories_campaign"),
        ),
    )


def create_scenes() -> None:
    op.create_table(
        "scenes",
        sa.Column("campaign", ID, nullable=False),
        sa.Column("index", ID, autoincrement=False, nullable=False),
        sa.Column("scene", sa.LargeBinary(), nullable=False),
        sa.PrimaryKeyConstraint("campaign", "index", name=op.f("pk_scenes")),
        sa.ForeignKeyConstraint(
            ["campaign", "index"],
            ["episodes.campaign", "episodes.index"],
            name=op.f("fk_scenes_campaign"),
        ),
    )


def create_checkpoints() -> None:
    op.create_table(
        "checkpoints",
        sa.Column("campaign", ID, autoincrement=False, nullable=False),
        sa.Column("saved_ms", sa.BigInteger(), nullable=False),
        sa.Column("state", sa.LargeBinary(), nullable=False),
        sa.PrimaryKeyConstraint("campaign", name=op.f("pk_checkpoints")),
        sa.ForeignKeyConstraint(
            ["campaign"], ["campaigns.id"], name=op.f("fk_checkpoints_campaign")
        ),
    )


def create_analyses() -> None:
    op.create_table(
        "analyses",
        sa.Column("id", ID, nullable=False),
        sa.Column("campaign", ID, nullable=False),
        sa.Column("settings", sa.Text(), nullable=False),
        sa.Column("state", sa.Text(), nullable=False),
        sa.Column("created_ms", sa.BigInteger(), nullable=False),
        sa.Column("problem", sa.Text(), nullable=False),
        sa.Column("replay_campaign", ID),
        sa.Column("failures", sa.Integer()),
        sa.Column("modes", sa.Integer()),
        sa.Column("silhouette", sa.Double()),
        sa.Column("noise_silhouette", sa.Double()),
        sa.Column("result", sa.LargeBinary()),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_analyses")),
        sa.ForeignKeyConstraint(["campaign"], ["campaigns.id"], name=op.f("fk_analyses_campaign")),
        sa.ForeignKeyConstraint(
            ["replay_campaign"], ["campaigns.id"], name=op.f("fk_analyses_replay_campaign")
        ),
        sqlite_autoincrement=True,
    )
    op.create_index(op.f("ix_analyses_campaign_id"), "analyses", ["campaign", "id"])


def create_events() -> None:
    op.create_table(
        "events",
        sa.Column("id", ID, autoincrement=False, nullable=False),
        sa.Column("at_ms", sa.BigInteger(), nullable=False),
        sa.Column("kind", sa.Text(), nullable=False),
        sa.Column("message", sa.Text(), nullable=False),
        sa.Column("campaign", ID),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_events")),
    )
    op.create_index(op.f("ix_events_campaign_id"), "events", ["campaign", "id"])
    counter = op.create_table(
        "event_counter",
        sa.Column("id", sa.Integer(), autoincrement=False, nullable=False),
        sa.Column("last", sa.BigInteger(), nullable=False),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_event_counter")),
    )
    op.bulk_insert(counter, [{"id": 1, "last": 0}])


def create_jobs() -> None:
    op.create_table(
        "jobs",
        sa.Column("id", ID, nullable=False),
        sa.Column("kind", sa.Text(), nullable=False),
        sa.Column("subject", ID, nullable=False),
        sa.Column("queued_ms", sa.BigInteger(), nullable=False),
        sa.Column("owner", sa.Text()),
        sa.Column("token", sa.Text()),
        sa.Column("lease_until_ms", sa.BigInteger(), nullable=False),
        sa.Column("attempts", sa.Integer(), nullable=False),
        sa.Column("progress", sa.BigInteger(), nullable=False),
        sa.Column("buried_because", sa.Text()),
        sa.PrimaryKeyConstraint("id", name=op.f("pk_jobs")),
        sa.UniqueConstraint("kind", "subject", name=op.f("uq_jobs_kind_subject")),
        sqlite_autoincrement=True,
    )
