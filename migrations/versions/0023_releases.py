"""Version of the planner, project, tags and code of campaigns."""

import sqlalchemy as sa
from alembic import op

revision = "0023"
down_revision = "0022"
branch_labels = None
depends_on = None

COLUMNS = ("planner_version", "project", "tags", "code")
INDEXED = ("planner_version", "project")


def upgrade() -> None:
    """Add the columns, empty: earlier releases recorded none of them."""
    for name in COLUMNS:
        op.add_column("campaigns", sa.Column(name, sa.Text()))
    for name in INDEXED:
        op.create_index(f"ix_campaigns_{name}_id", "campaigns", [name, "id"])


def downgrade() -> None:
    """Drop the columns; projects, tags and fingerprints are lost."""
    for name in INDEXED:
        op.drop_index(f"ix_campaigns_{name}_id", "campaigns")
    for name in COLUMNS:
        op.drop_column("campaigns", name)
