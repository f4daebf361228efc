"""What a campaign's learner knows of the failure probability; empty where none told."""

import sqlalchemy as sa
from alembic import op

revision = "0003"
down_revision = "0002"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.add_column("campaigns", sa.Column("estimate", sa.Text()))


def downgrade() -> None:
    op.drop_column("campaigns", "estimate")
