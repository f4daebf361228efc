"""The priority of a campaign, by which key it was made, and the quotas of keys."""

import sqlalchemy as sa
from alembic import op

revision = "0014"
down_revision = "0013"
branch_labels = None
depends_on = None

NUMBER = sa.BigInteger().with_variant(sa.Integer(), "sqlite")
INDEXED = ("created_ms", "ended_ms")
QUOTAS = ("max_open", "max_episodes", "max_episodes_per_day")


def upgrade() -> None:
    priority = sa.Column("priority", sa.Text(), nullable=False, server_default="normal")
    op.add_column("campaigns", priority)
    op.add_column("campaigns", sa.Column("made_by", NUMBER))
    for column in INDEXED:
        op.create_index(f"ix_campaigns_made_by_{column}", "campaigns", ["made_by", column])
    for quota in QUOTAS:
        op.add_column("keys", sa.Column(quota, sa.BigInteger()))


def downgrade() -> None:
    for quota in QUOTAS:
        op.drop_column("keys", quota)
    for column in INDEXED:
        op.drop_index(f"ix_campaigns_made_by_{column}", "campaigns")
    op.drop_column("campaigns", "made_by")
    op.drop_column("campaigns", "priority")
