"""The suite of a campaign, read from its name; empty where it belongs to none."""

import json
import re

import sqlalchemy as sa
from alembic import op

revision = "0007"
down_revision = "0006"
branch_labels = None
depends_on = None

INDEX = "ix_campaigns_suite_id"
OFFSPRING = re.compile(
    r": (replay of (analysis \d+|\d+/\d+)|minimal failure of \d+/\d+)(,.*)?$", re.DOTALL
)


def upgrade() -> None:
    op.add_column("campaigns", sa.Column("suite", sa.Text()))
    fill(op.get_bind())
    op.create_index(INDEX, "campaigns", ["suite", "id"])


def downgrade() -> None:
    op.drop_index(INDEX, "campaigns")
    op.drop_column("campaigns", "suite")


def fill(connection: sa.Connection) -> None:
    campaigns = sa.table("campaigns", sa.column("id"), sa.column("spec"), sa.column("suite"))
    specs = connection.execute(sa.select(campaigns.c.id, campaigns.c.spec)).all()
    named = ((each.id, suite_of(json.loads(each.spec)["name"])) for each in specs)
    rows = [{"campaign": campaign, "named": suite} for campaign, suite in named if suite]
    if rows:
        change = sa.update(campaigns).where(campaigns.c.id == sa.bindparam("campaign"))
        connection.execute(change.values(suite=sa.bindparam("named")), rows)


def suite_of(name: str) -> str:
    suite, _, member = name.partition(": ")
    return "" if not member or OFFSPRING.search(name) else suite.replace("\x00", "�")
