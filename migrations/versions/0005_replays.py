"""An analysis is replayed in several scenarios: a table of its replays instead of a column."""

import sqlalchemy as sa
from alembic import op

revision = "0005"
down_revision = "0004"
branch_labels = None
depends_on = None

ID = sa.BigInteger().with_variant(sa.Integer(), "sqlite")
FOREIGN_KEY = "fk_analyses_replay_campaign"
KEEPS_COUNTING = {"sqlite_autoincrement": True}

FILL = """
INSERT INTO replays (analysis, campaign)
SELECT id, replay_campaign FROM analyses WHERE replay_campaign IS NOT NULL
"""
FILL_BACK = """
UPDATE analyses SET replay_campaign =
(SELECT max(replays.campaign) FROM replays WHERE replays.analysis = analyses.id)
"""


def upgrade() -> None:
    op.create_table(
        "replays",
        sa.Column("analysis", ID, autoincrement=False, nullable=False),
        sa.Column("campaign", ID, autoincrement=False, nullable=False),
        sa.PrimaryKeyConstraint("analysis", "campaign", name=op.f("pk_replays")),
        sa.ForeignKeyConstraint(["analysis"], ["analyses.id"], name=op.f("fk_replays_analysis")),
        sa.ForeignKeyConstraint(["campaign"], ["campaigns.id"], name=op.f("fk_replays_campaign")),
    )
    op.execute(FILL)
    with op.batch_alter_table("analyses", table_kwargs=KEEPS_COUNTING) as analyses:
        analyses.drop_constraint(op.f(FOREIGN_KEY), type_="foreignkey")
        analyses.drop_column("replay_campaign")


def downgrade() -> None:
    with op.batch_alter_table("analyses", table_kwargs=KEEPS_COUNTING) as analyses:
        analyses.add_column(sa.Column("replay_campaign", ID))
        analyses.create_foreign_key(op.f(FOREIGN_KEY), "campaigns", ["replay_campaign"], ["id"])
    op.execute(FILL_BACK)
    op.drop_table("replays")
