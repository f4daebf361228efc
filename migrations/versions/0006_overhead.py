"""What a campaign's active time went into beside simulation; empty where nobody measured it."""

import sqlalchemy as sa
from alembic import op

revision = "0006"
down_revision = "0005"
branch_labels = None
depends_on = None

SECONDS = ("learning_s", "waiting_s", "discarded_s")


def upgrade() -> None:
    for name in SECONDS:
        op.add_column("campaigns", sa.Column(name, sa.Double()))


def downgrade() -> None:
    for name in reversed(SECONDS):
        op.drop_column("campaigns", name)
