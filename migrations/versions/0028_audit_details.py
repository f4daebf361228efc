"""Details of the changes in the audit log: fields with their values."""

import sqlalchemy as sa
from alembic import op

revision = "0028"
down_revision = "0027"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Add the column; lines of earlier releases have no details."""
    op.add_column("audit", sa.Column("details", sa.Text(), nullable=False, server_default=""))


def downgrade() -> None:
    """Drop the column: the details are lost, the lines stay."""
    op.drop_column("audit", "details")
