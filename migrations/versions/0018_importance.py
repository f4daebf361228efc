"""The importance of each step, of episodes whose method asks for it."""

import sqlalchemy as sa
from alembic import op

revision = "0018"
down_revision = "0017"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.add_column("trajectories", sa.Column("importance", sa.LargeBinary()))


def downgrade() -> None:
    op.drop_column("trajectories", "importance")
