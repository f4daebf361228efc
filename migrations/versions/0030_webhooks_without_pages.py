"""Webhooks are listed with their last deliveries: no counts by state, no end of a delivery."""

import sqlalchemy as sa
from alembic import op

revision = "0030"
down_revision = "0029"
branch_labels = None
depends_on = None

_INDEX = "ix_webhook_deliveries_webhook_state"


def upgrade() -> None:
    """Drop what counted deliveries by state, and when they ended."""
    op.drop_index(_INDEX, "webhook_deliveries")
    op.drop_column("webhook_deliveries", "ended_ms")


def downgrade() -> None:
    """Add both; deliveries that ended before have no time of their end."""
    op.add_column("webhook_deliveries", sa.Column("ended_ms", sa.BigInteger(), nullable=True))
    op.create_index(_INDEX, "webhook_deliveries", ["webhook", "state"])
