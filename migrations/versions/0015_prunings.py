"""What was taken away of the noise of episodes, to make room."""

import sqlalchemy as sa
from alembic import op

from eigenfail.errors import Conflict

revision = "0015"
down_revision = "0014"
branch_labels = None
depends_on = None

NUMBER = sa.BigInteger().with_variant(sa.Integer(), "sqlite")


def upgrade() -> None:
    op.create_table(
        "prunings",
        sa.Column("id", NUMBER, nullable=False),
        sa.Column("campaign", NUMBER, nullable=False),
        sa.Column("source", sa.Text(), nullable=False),
        sa.Column("keep_every", sa.BigInteger(), nullable=False),
        sa.Column("through", NUMBER, nullable=False),
        sa.Column("pruned_ms", sa.BigInteger(), nullable=False),
        sa.Column("who", sa.Text(), nullable=False),
        sa.Column("episodes", sa.BigInteger(), nullable=False),
        sa.Column("scenes", sa.BigInteger(), nullable=False),
        sa.Column("bytes", sa.BigInteger(), nullable=False),
        sa.ForeignKeyConstraint(["campaign"], ["campaigns.id"], name="fk_prunings_campaign"),
        sa.PrimaryKeyConstraint("id", name="pk_prunings"),
        sqlite_autoincrement=True,
    )
    op.create_index("ix_prunings_campaign_id", "prunings", ["campaign", "id"])


def downgrade() -> None:
    # An older program would leave episodes without noise out of what it counts, and say nothing.
    if op.get_bind().execute(sa.text("SELECT count(*) FROM prunings")).scalar_one():
        raise Conflict(
            "Noise of this database was pruned, which programs of an older schema know nothing of.",
            "Restore a backup from before the pruning: eigenfail db restore.",
        )
    op.drop_table("prunings")
