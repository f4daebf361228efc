"""Triage of failure modes and episodes, notes on them, and the archive of campaigns."""

import sqlalchemy as sa
from alembic import op

revision = "0024"
down_revision = "0023"
branch_labels = None
depends_on = None


def upgrade() -> None:
    """Create the tables and the column."""
    op.add_column("campaigns", sa.Column("archived_ms", sa.BigInteger()))
    number = sa.BigInteger().with_variant(sa.Integer(), "sqlite")
    op.create_table(
        "triage",
        sa.Column("kind", sa.Text(), nullable=False),
        sa.Column("parent", number, nullable=False, autoincrement=False),
        sa.Column("number", number, nullable=False, autoincrement=False),
        sa.Column("state", sa.Text(), nullable=False),
        sa.Column("owner", sa.Text(), nullable=False),
        sa.Column("labels", sa.Text(), nullable=False),
        sa.Column("ticket", sa.Text(), nullable=False),
        sa.Column("changed_ms", sa.BigInteger(), nullable=False),
        sa.Column("changed_by", sa.Text(), nullable=False),
        sa.PrimaryKeyConstraint("kind", "parent", "number", name="pk_triage"),
    )
    op.create_table(
        "triage_notes",
        sa.Column("id", number, nullable=False),
        sa.Column("kind", sa.Text(), nullable=False),
        sa.Column("parent", number, nullable=False),
        sa.Column("number", number, nullable=False),
        sa.Column("at_ms", sa.BigInteger(), nullable=False),
        sa.Column("author", sa.Text(), nullable=False),
        sa.Column("text", sa.Text(), nullable=False),
        sa.PrimaryKeyConstraint("id", name="pk_triage_notes"),
        sqlite_autoincrement=True,
    )
    op.create_index(
        "ix_triage_notes_kind_parent_number_id", "triage_notes", ["kind", "parent", "number", "id"]
    )


def downgrade() -> None:
    """Drop the tables and the column; triage and notes are lost, and no campaign is archived."""
    op.drop_index("ix_triage_notes_kind_parent_number_id", "triage_notes")
    op.drop_table("triage_notes")
    op.drop_table("triage")
    op.drop_column("campaigns", "archived_ms")
