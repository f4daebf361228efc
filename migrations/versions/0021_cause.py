"""Cause of a collision, in scenarios that name it."""

import sqlalchemy as sa
from alembic import op

revision = "0021"
down_revision = "0020"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.add_column("episodes", sa.Column("cause", sa.Text()))


def downgrade() -> None:
    op.drop_column("episodes", "cause")
