"""Classes by the braking of the ego: episodes have its peak, and an index holds the unresolved."""

import sqlalchemy as sa
from alembic import op

revision = "1004"
down_revision = "1003"
branch_labels = None
depends_on = None

ENDED = (
    "campaign",
    "outcome",
    "index",
    "log_probability",
    "steps",
    "severity",
    "collided_s",
    "ttc_violated_s",
    "drac_violated_s",
    "drac_at_warning_mps2",
)
UNRESOLVED = (
    "final_drac_mps2 > coalesce(peak_braking_mps2, 7.0) AND outcome = 'safe' AND collided_s IS NULL"
)


def upgrade() -> None:
    # Without a value the peak of the paper counts, by which earlier episodes were judged.
    op.add_column("episodes", sa.Column("peak_braking_mps2", sa.Double()))
    op.drop_index("ix_episodes_ended", "episodes")
    op.create_index("ix_episodes_ended", "episodes", [*ENDED, "peak_braking_mps2"])
    condition = sa.text(UNRESOLVED)
    op.create_index(
        "ix_episodes_unresolved",
        "episodes",
        ["campaign", "outcome"],
        sqlite_where=condition,
        postgresql_where=condition,
    )


def downgrade() -> None:
    op.drop_index("ix_episodes_unresolved", "episodes")
    op.drop_index("ix_episodes_ended", "episodes")
    op.create_index("ix_episodes_ended", "episodes", list(ENDED))
    op.drop_column("episodes", "peak_braking_mps2")
