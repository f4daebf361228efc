"""Indices that hold what the pages of a campaign sum over, so that its rows need not be read."""

from alembic import op

revision = "0009"
down_revision = "0008"
branch_labels = None
depends_on = None

LANDED = (
    *("campaign", "finished_ms", "index", "outcome", "robustness_m", "log_probability"),
    *("steps", "wall_s"),
)
ENDED = (
    *("campaign", "outcome", "index", "log_probability", "steps", "severity", "collided_s"),
    *("ttc_violated_s", "drac_violated_s", "drac_at_warning_mps2"),
)
MEASURES = ("min_ttc_s", "max_drac_mps2")


def upgrade() -> None:
    op.create_index("ix_episodes_landed", "episodes", LANDED)
    op.create_index("ix_episodes_ended", "episodes", ENDED)
    op.drop_index("ix_episodes_campaign_outcome_index", "episodes")
    for column in MEASURES:
        columns = ["campaign", column, "index", "outcome"]
        op.create_index(f"ix_episodes_campaign_{column}_index_outcome", "episodes", columns)
        op.drop_index(f"ix_episodes_campaign_{column}_index", "episodes")


def downgrade() -> None:
    for column in reversed(MEASURES):
        op.create_index(
            f"ix_episodes_campaign_{column}_index", "episodes", ["campaign", column, "index"]
        )
        op.drop_index(f"ix_episodes_campaign_{column}_index_outcome", "episodes")
    op.create_index(
        "ix_episodes_campaign_outcome_index", "episodes", ["campaign", "outcome", "index"]
    )
    op.drop_index("ix_episodes_ended", "episodes")
    op.drop_index("ix_episodes_landed", "episodes")
