"""Indices for the orders in which episodes are asked for most."""

from alembic import op

revision = "0008"
down_revision = "0007"
branch_labels = None
depends_on = None

COLUMNS = ("robustness_m", "log_probability", "severity", "min_ttc_s", "max_drac_mps2")


def upgrade() -> None:
    for column in COLUMNS:
        name = f"ix_episodes_campaign_{column}_index"
        op.create_index(name, "episodes", ["campaign", column, "index"])


def downgrade() -> None:
    for column in reversed(COLUMNS):
        op.drop_index(f"ix_episodes_campaign_{column}_index", "episodes")
