"""The versions of the services that ran a campaign, part by part; of older parts none are known."""

import sqlalchemy as sa
from alembic import op

revision = "0017"
down_revision = "0016"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.add_column("campaigns", sa.Column("parts", sa.Text()))


def downgrade() -> None:
    op.drop_column("campaigns", "parts")
