"""What the bridges of connected workers offer to campaigns."""

import sqlalchemy as sa
from alembic import op

revision = "0020"
down_revision = "0019"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.add_column("arrivals", sa.Column("offer", sa.Text()))


def downgrade() -> None:
    op.drop_column("arrivals", "offer")
