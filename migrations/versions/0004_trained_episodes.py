"""How many episodes a campaign's learner was trained with; empty where none told."""

import sqlalchemy as sa
from alembic import op

revision = "0004"
down_revision = "0003"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.add_column("campaigns", sa.Column("trained_episodes", sa.Integer()))


def downgrade() -> None:
    op.drop_column("campaigns", "trained_episodes")
