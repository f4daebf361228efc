"""What requirements say of an episode: the first that is violated, and the robustness of each."""

import sqlalchemy as sa
from alembic import op

from eigenfail.errors import Conflict

revision = "0019"
down_revision = "0018"
branch_labels = None
depends_on = None


def upgrade() -> None:
    op.add_column("episodes", sa.Column("nearest_m", sa.Double()))
    op.add_column("episodes", sa.Column("violated", sa.Integer()))
    op.create_index(
        "ix_episodes_campaign_violated_index",
        "episodes",
        ["campaign", "violated", "index"],
        sqlite_where=sa.text("violated IS NOT NULL"),
        postgresql_where=sa.text("violated IS NOT NULL"),
    )
    number = sa.BigInteger().with_variant(sa.Integer(), "sqlite")
    op.create_table(
        "requirement_values",
        sa.Column("campaign", number, nullable=False),
        sa.Column("index", number, nullable=False, autoincrement=False),
        sa.Column("requirement", sa.Integer(), nullable=False, autoincrement=False),
        sa.Column("robustness", sa.Double(), nullable=False),
        sa.PrimaryKeyConstraint("campaign", "index", "requirement", name="pk_requirement_values"),
        sa.ForeignKeyConstraint(
            ["campaign", "index"],
            ["episodes.campaign", "episodes.index"],
            name="fk_requirement_values_campaign",
        ),
    )


def downgrade() -> None:
    # An older program would take violations for safe episodes, and cannot read the campaigns.
    found = op.get_bind().execute(sa.text("SELECT count(*) FROM requirement_values"))
    if found.scalar_one():
        raise Conflict(
            "Campaigns of this database have requirements, which programs of an older schema know "
            "nothing of.",
            "Restore a backup from before the first of them: eigenfail db restore.",
        )
    op.drop_table("requirement_values")
    op.drop_index("ix_episodes_campaign_violated_index", "episodes")
    op.drop_column("episodes", "violated")
    op.drop_column("episodes", "nearest_m")
