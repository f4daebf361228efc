"""More safety measures of an episode; what was not measured stays empty."""

import sqlalchemy as sa
from alembic import op

revision = "0002"
down_revision = "0001"
branch_labels = None
depends_on = None

NUMBERS = (
    "ttc_violated_s",
    "drac_violated_s",
    "drac_at_warning_mps2",
    "collided_s",
    "left_road_s",
    "max_jerk_mps3",
)
COUNTS = ("hard_brakings", "clipped_steps")
INDEX = "ix_episodes_campaign_outcome_min_ttc_s"


def upgrade() -> None:
    for name in NUMBERS:
        op.add_column("episodes", sa.Column(name, sa.Double()))
    for name in COUNTS:
        op.add_column("episodes", sa.Column(name, sa.Integer()))
    op.create_index(op.f(INDEX), "episodes", ["campaign", "outcome", "min_ttc_s"])


def downgrade() -> None:
    op.drop_index(op.f(INDEX), "episodes")
    for name in (*COUNTS, *NUMBERS):
        op.drop_column("episodes", name)
