"""How many workers were lost while they ran an episode: counted beyond the hub that noticed."""

import sqlalchemy as sa
from alembic import op

revision = "0012"
down_revision = "0011"
branch_labels = None
depends_on = None

NUMBER = sa.BigInteger().with_variant(sa.Integer(), "sqlite")


def upgrade() -> None:
    op.create_table(
        "deaths",
        sa.Column("campaign", NUMBER, nullable=False),
        sa.Column("index", NUMBER, autoincrement=False, nullable=False),
        sa.Column("workers", sa.Integer(), nullable=False),
        sa.ForeignKeyConstraint(["campaign"], ["campaigns.id"], name="fk_deaths_campaign"),
        sa.PrimaryKeyConstraint("campaign", "index", name="pk_deaths"),
    )


def downgrade() -> None:
    op.drop_table("deaths")
