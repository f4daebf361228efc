"""The tables of version 0.1.0."""

import sqlalchemy as sa
from alembic import op

revision = "1003"
down_revision = None
branch_labels = None
depends_on = None

ID = sa.BigInteger().with_variant(sa.Integer(), "sqlite")


def upgrade() -> None:
    create_campaigns()
    create_idempotency_keys()
    create_checkpoints()
    create_episodes()
    create_requirement_values()
    create_trajectories()
    create_scenes()
    create_prunings()
    create_deaths()
    create_analyses()
    create_modes()
    create_mode_members()
    create_replays()
    create_events()
    create_event_counter()
    create_jobs()
    create_arrivals()
    create_keys()
    create_audit()
    create_gates()
    create_plugins()


def downgrade() -> None:
    for table in (
        "plugins",
        "gates",
        "audit",
        "keys",
        "arrivals",
        "jobs",
        "event_counter",
        "events",
        "replays",
        "mode_members",
        "modes",
        "analyses",
        "deaths",
        "prunings",
        "scenes",
        "trajectories",
        "requirement_values",
        "episodes",
        "checkpoints",
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
        sa.Column("estimate", sa.Text()),
        sa.Column("trained_episodes", sa.Integer()),
        sa.Column("learning_s", sa.Double(), nullable=False),
        sa.Column("waiting_s", sa.Double(), nullable=False),
        sa.Column("discarded_s", sa.Double(), nullable=False),
        sa.Column("suite", sa.Text()),
        sa.Column("priority", sa.Text(), nullable=False, server_default="normal"),
        sa.Column("made_by", ID),
        sa.Column("parts", sa.Text()),
        sa.Column("planner_version", sa.Text()),
        sa.Column("project", sa.Text()),
        sa.Column("tags", sa.Text()),
        sa.Column("code", sa.Text()),
        sa.Column("archived_ms", sa.BigInteger()),
        sa.Column("form", sa.Text(), nullable=False),
        sa.Column("references", sa.Text(), nullable=False),
        sa.PrimaryKeyConstraint("id", name="pk_campaigns"),
        sa.CheckConstraint(
            "completed + failed + cancelled <= planned", name=op.f("ck_campaigns_accounted")
        ),
        sqlite_autoincrement=True,
    )
    op.create_index("ix_campaigns_made_by_created_ms", "campaigns", ["made_by", "created_ms"])
    op.create_index("ix_campaigns_made_by_ended_ms", "campaigns", ["made_by", "ended_ms"])
    op.create_index("ix_campaigns_planner_version_id", "campaigns", ["planner_version", "id"])
    op.create_index("ix_campaigns_project_id", "campaigns", ["project", "id"])
    op.create_index("ix_campaigns_state_id", "campaigns", ["state", "id"])
    op.create_index("ix_campaigns_suite_id", "campaigns", ["suite", "id"])
    op.create_index(
        "ix_campaigns_versioned",
        "campaigns",
        ["id"],
        sqlite_where=sa.text("planner_version IS NOT NULL"),
        postgresql_where=sa.text("planner_version IS NOT NULL"),
    )


def create_idempotency_keys() -> None:
    op.create_table(
        "idempotency_keys",
        sa.Column("key", sa.Text(), nullable=False),
        sa.Column("spec_hash", sa.Text(), nullable=False),
        sa.Column("campaign", ID, nullable=False),
        sa.PrimaryKeyConstraint("key", name="pk_idempotency_keys"),
        sa.ForeignKeyConstraint(
            ["campaign"], ["campaigns.id"], name="fk_idempotency_keys_campaign"
        ),
    )


def create_checkpoints() -> None:
    op.create_table(
        "checkpoints",
        sa.Column("campaign", ID, autoincrement=False, nullable=False),
        sa.Column("saved_ms", sa.BigInteger(), nullable=False),
        sa.Column("state", sa.LargeBinary(), nullable=False),
        sa.Column("number", sa.BigInteger(), autoincrement=False, nullable=False),
        sa.Column("sha256", sa.Text(), nullable=False),
        sa.PrimaryKeyConstraint("campaign", "number", name="pk_checkpoints"),
        sa.ForeignKeyConstraint(["campaign"], ["campaigns.id"], name="fk_checkpoints_campaign"),
    )


def create_episodes() -> None:
    op.create_table(
        "episodes",
        sa.Column("campaign", ID, autoincrement=False, nullable=False),
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
        sa.Column("ttc_violated_s", sa.Double()),
        sa.Column("drac_violated_s", sa.Double()),
        sa.Column("drac_at_warning_mps2", sa.Double()),
        sa.Column("collided_s", sa.Double()),
        sa.Column("left_road_s", sa.Double()),
        sa.Column("max_jerk_mps3", sa.Double()),
        sa.Column("hard_brakings", sa.Integer()),
        sa.Column("clipped_steps", sa.Integer()),
        sa.Column("final_drac_mps2", sa.Double()),
        sa.Column("nearest_m", sa.Double()),
        sa.Column("violated", sa.Integer()),
        sa.Column("cause", sa.Text()),
        sa.PrimaryKeyConstraint("campaign", "index", name="pk_episodes"),
        sa.ForeignKeyConstraint(["campaign"], ["campaigns.id"], name="fk_episodes_campaign"),
    )
    op.create_index(
        "ix_episodes_campaign_log_probability_index",
        "episodes",
        ["campaign", "log_probability", "index"],
    )
    op.create_index(
        "ix_episodes_campaign_max_drac_mps2_index_outcome",
        "episodes",
        ["campaign", "max_drac_mps2", "index", "outcome"],
    )
    op.create_index(
        "ix_episodes_campaign_min_ttc_s_index_outcome",
        "episodes",
        ["campaign", "min_ttc_s", "index", "outcome"],
    )
    op.create_index(
        "ix_episodes_campaign_outcome_min_ttc_s", "episodes", ["campaign", "outcome", "min_ttc_s"]
    )
    op.create_index(
        "ix_episodes_campaign_robustness_m_index", "episodes", ["campaign", "robustness_m", "index"]
    )
    op.create_index(
        "ix_episodes_campaign_severity_index", "episodes", ["campaign", "severity", "index"]
    )
    op.create_index(
        "ix_episodes_campaign_violated_index",
        "episodes",
        ["campaign", "violated", "index"],
        sqlite_where=sa.text("violated IS NOT NULL"),
        postgresql_where=sa.text("violated IS NOT NULL"),
    )
    op.create_index(
        "ix_episodes_ended",
        "episodes",
        [
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
        ],
    )
    op.create_index(
        "ix_episodes_landed",
        "episodes",
        [
            "campaign",
            "finished_ms",
            "index",
            "outcome",
            "robustness_m",
            "log_probability",
            "steps",
            "wall_s",
        ],
    )


def create_requirement_values() -> None:
    op.create_table(
        "requirement_values",
        sa.Column("campaign", ID, autoincrement=False, nullable=False),
        sa.Column("index", ID, autoincrement=False, nullable=False),
        sa.Column("requirement", sa.Integer(), autoincrement=False, nullable=False),
        sa.Column("robustness", sa.Double(), nullable=False),
        sa.PrimaryKeyConstraint("campaign", "index", "requirement", name="pk_requirement_values"),
        sa.ForeignKeyConstraint(
            ["campaign", "index"],
            ["episodes.campaign", "episodes.index"],
            name="fk_requirement_values_campaign",
        ),
    )


def create_trajectories() -> None:
    op.create_table(
        "trajectories",
        sa.Column("campaign", ID, autoincrement=False, nullable=False),
        sa.Column("index", ID, autoincrement=False, nullable=False),
        sa.Column("z", sa.LargeBinary(), nullable=False),
        sa.Column("sigma", sa.LargeBinary(), nullable=False),
        sa.Column("states", sa.LargeBinary()),
        sa.Column("importance", sa.LargeBinary()),
        sa.PrimaryKeyConstraint("campaign", "index", name="pk_trajectories"),
        sa.ForeignKeyConstraint(
            ["campaign", "index"],
            ["episodes.campaign", "episodes.index"],
            name="fk_trajectories_campaign",
        ),
    )


def create_scenes() -> None:
    op.create_table(
        "scenes",
        sa.Column("campaign", ID, autoincrement=False, nullable=False),
        sa.Column("index", ID, autoincrement=False, nullable=False),
        sa.Column("scene", sa.LargeBinary(), nullable=False),
        sa.PrimaryKeyConstraint("campaign", "index", name="pk_scenes"),
        sa.ForeignKeyConstraint(
            ["campaign", "index"],
            ["episodes.campaign", "episodes.index"],
            name="fk_scenes_campaign",
        ),
    )


def create_prunings() -> None:
    op.create_table(
        "prunings",
        sa.Column("id", ID, nullable=False),
        sa.Column("campaign", ID, nullable=False),
        sa.Column("source", sa.Text(), nullable=False),
        sa.Column("keep_every", sa.BigInteger(), nullable=False),
        sa.Column("through", ID, nullable=False),
        sa.Column("pruned_ms", sa.BigInteger(), nullable=False),
        sa.Column("who", sa.Text(), nullable=False),
        sa.Column("episodes", sa.BigInteger(), nullable=False),
        sa.Column("scenes", sa.BigInteger(), nullable=False),
        sa.Column("bytes", sa.BigInteger(), nullable=False),
        sa.PrimaryKeyConstraint("id", name="pk_prunings"),
        sa.ForeignKeyConstraint(["campaign"], ["campaigns.id"], name="fk_prunings_campaign"),
        sqlite_autoincrement=True,
    )
    op.create_index("ix_prunings_campaign_id", "prunings", ["campaign", "id"])


def create_deaths() -> None:
    op.create_table(
        "deaths",
        sa.Column("campaign", ID, autoincrement=False, nullable=False),
        sa.Column("index", ID, autoincrement=False, nullable=False),
        sa.Column("workers", sa.Integer(), nullable=False),
        sa.PrimaryKeyConstraint("campaign", "index", name="pk_deaths"),
        sa.ForeignKeyConstraint(["campaign"], ["campaigns.id"], name="fk_deaths_campaign"),
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
        sa.Column("failures", sa.Integer()),
        sa.Column("modes", sa.Integer()),
        sa.Column("silhouette", sa.Double()),
        sa.Column("noise_silhouette", sa.Double()),
        sa.Column("result", sa.LargeBinary()),
        sa.PrimaryKeyConstraint("id", name="pk_analyses"),
        sa.ForeignKeyConstraint(["campaign"], ["campaigns.id"], name="fk_analyses_campaign"),
        sqlite_autoincrement=True,
    )
    op.create_index("ix_analyses_campaign_id", "analyses", ["campaign", "id"])


def create_modes() -> None:
    op.create_table(
        "modes",
        sa.Column("analysis", ID, autoincrement=False, nullable=False),
        sa.Column("number", sa.Integer(), autoincrement=False, nullable=False),
        sa.Column("failures", sa.Integer(), nullable=False),
        sa.Column("name", sa.Text(), nullable=False),
        sa.Column("state", sa.Text(), nullable=False, server_default="new"),
        sa.Column("ticket", sa.Text(), nullable=False, server_default=""),
        sa.Column("note", sa.Text(), nullable=False, server_default=""),
        sa.Column("changed_by", sa.Text(), nullable=False, server_default=""),
        sa.Column("changed_ms", sa.BigInteger()),
        sa.PrimaryKeyConstraint("analysis", "number", name="pk_modes"),
        sa.ForeignKeyConstraint(["analysis"], ["analyses.id"], name="fk_modes_analysis"),
    )


def create_mode_members() -> None:
    op.create_table(
        "mode_members",
        sa.Column("campaign", ID, autoincrement=False, nullable=False),
        sa.Column("analysis", ID, autoincrement=False, nullable=False),
        sa.Column("index", ID, autoincrement=False, nullable=False),
        sa.Column("number", sa.Integer(), nullable=False),
        sa.PrimaryKeyConstraint("campaign", "analysis", "index", name="pk_mode_members"),
        sa.ForeignKeyConstraint(["analysis"], ["analyses.id"], name="fk_mode_members_analysis"),
        sa.ForeignKeyConstraint(["campaign"], ["campaigns.id"], name="fk_mode_members_campaign"),
    )
    op.create_index("ix_mode_members_analysis_number", "mode_members", ["analysis", "number"])


def create_replays() -> None:
    op.create_table(
        "replays",
        sa.Column("analysis", ID, autoincrement=False, nullable=False),
        sa.Column("campaign", ID, autoincrement=False, nullable=False),
        sa.PrimaryKeyConstraint("analysis", "campaign", name="pk_replays"),
        sa.ForeignKeyConstraint(["analysis"], ["analyses.id"], name="fk_replays_analysis"),
        sa.ForeignKeyConstraint(["campaign"], ["campaigns.id"], name="fk_replays_campaign"),
    )


def create_events() -> None:
    op.create_table(
        "events",
        sa.Column("id", ID, autoincrement=False, nullable=False),
        sa.Column("at_ms", sa.BigInteger(), nullable=False),
        sa.Column("kind", sa.Text(), nullable=False),
        sa.Column("message", sa.Text(), nullable=False),
        sa.Column("campaign", ID),
        sa.Column("subject", ID),
        sa.Column("state", sa.Text(), nullable=False),
        sa.PrimaryKeyConstraint("id", name="pk_events"),
    )
    op.create_index("ix_events_campaign_id", "events", ["campaign", "id"])


def create_event_counter() -> None:
    counter = op.create_table(
        "event_counter",
        sa.Column("id", sa.Integer(), autoincrement=False, nullable=False),
        sa.Column("last", sa.BigInteger(), nullable=False),
        sa.PrimaryKeyConstraint("id", name="pk_event_counter"),
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
        sa.Column("lease_ms", sa.BigInteger(), nullable=False, server_default="0"),
        sa.PrimaryKeyConstraint("id", name="pk_jobs"),
        sa.UniqueConstraint("kind", "subject", name="uq_jobs_kind_subject"),
        sqlite_autoincrement=True,
    )


def create_arrivals() -> None:
    op.create_table(
        "arrivals",
        sa.Column("id", ID, nullable=False),
        sa.Column("worker", sa.Text(), nullable=False),
        sa.Column("host", sa.Text(), nullable=False),
        sa.Column("pid", sa.BigInteger(), nullable=False),
        sa.Column("versions", sa.Text(), nullable=False),
        sa.Column("arrived_ms", sa.BigInteger(), nullable=False),
        sa.Column("heard_ms", sa.BigInteger(), nullable=False),
        sa.Column("left_ms", sa.BigInteger()),
        sa.Column("offer", sa.Text()),
        sa.PrimaryKeyConstraint("id", name="pk_arrivals"),
        sqlite_autoincrement=True,
    )
    op.create_index("ix_arrivals_worker_arrived_ms", "arrivals", ["worker", "arrived_ms"])


def create_keys() -> None:
    op.create_table(
        "keys",
        sa.Column("id", ID, nullable=False),
        sa.Column("name", sa.Text(), nullable=False),
        sa.Column("scope", sa.Text(), nullable=False),
        sa.Column("digest", sa.Text(), nullable=False),
        sa.Column("created_ms", sa.BigInteger(), nullable=False),
        sa.Column("expires_ms", sa.BigInteger()),
        sa.Column("revoked_ms", sa.BigInteger()),
        sa.Column("last_used_ms", sa.BigInteger()),
        sa.Column("max_open", sa.BigInteger()),
        sa.Column("max_episodes", sa.BigInteger()),
        sa.Column("max_episodes_per_day", sa.BigInteger()),
        sa.PrimaryKeyConstraint("id", name="pk_keys"),
        sqlite_autoincrement=True,
    )


def create_audit() -> None:
    op.create_table(
        "audit",
        sa.Column("id", ID, nullable=False),
        sa.Column("at_ms", sa.BigInteger(), nullable=False),
        sa.Column("who", sa.Text(), nullable=False),
        sa.Column("key", ID),
        sa.Column("method", sa.Text(), nullable=False),
        sa.Column("route", sa.Text(), nullable=False),
        sa.Column("subject", sa.Text(), nullable=False),
        sa.Column("address", sa.Text(), nullable=False),
        sa.Column("status", sa.Integer(), nullable=False),
        sa.Column("details", sa.Text(), nullable=False, server_default=""),
        sa.PrimaryKeyConstraint("id", name="pk_audit"),
        sqlite_autoincrement=True,
    )


def create_gates() -> None:
    op.create_table(
        "gates",
        sa.Column("id", ID, nullable=False),
        sa.Column("created_ms", sa.BigInteger(), nullable=False),
        sa.Column("digest", sa.Text(), nullable=False),
        sa.Column("suite", sa.Text(), nullable=False),
        sa.Column("version", sa.Text(), nullable=False),
        sa.Column("run", sa.Text(), nullable=False),
        sa.Column("baseline", sa.Text(), nullable=False),
        sa.Column("open", sa.Boolean(), nullable=False),
        sa.Column("counts", sa.Text(), nullable=False),
        sa.Column("conclusion", sa.Text(), nullable=False),
        sa.Column("report", sa.Text(), nullable=False),
        sa.PrimaryKeyConstraint("id", name="pk_gates"),
        sa.UniqueConstraint("digest", name="uq_gates_digest"),
        sqlite_autoincrement=True,
    )


def create_plugins() -> None:
    op.create_table(
        "plugins",
        sa.Column("name", sa.Text(), nullable=False),
        sa.Column("version", sa.Integer(), nullable=False),
        sa.PrimaryKeyConstraint("name", name="pk_plugins"),
    )
