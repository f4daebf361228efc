"""DRAC at the last step of an episode; of what ended before, it is not known."""

import sqlalchemy as sa
from alembic import op

revision = "0016"
down_revision = "0015"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.add_column("episodes", sa.Column("final_drac_mps2", sa.Double()))


def downgrade() -> None:
    op.drop_column("episodes", "final_drac_mps2")
