"""Triage of modes alone, in their rows: state, ticket and one note."""

import sqlalchemy as sa
from alembic import op

revision = "0031"
down_revision = "0030"
branch_labels = None
depends_on = None

_COLUMNS = ("state", "ticket", "note", "changed_ms", "changed_by")

_TAKE_TRIAGE = """
UPDATE modes SET (state, ticket, changed_ms, changed_by) = (
    SELECT triage.state, triage.ticket, triage.changed_ms, triage.changed_by FROM triage
    WHERE triage.kind = 'mode' AND triage.parent = modes.analysis AND triage.number = modes.number
) WHERE EXISTS (
    SELECT 1 FROM triage
    WHERE triage.kind = 'mode' AND triage.parent = modes.analysis AND triage.number = modes.number
)
"""

_TAKE_NEWEST_NOTE = """
UPDATE modes SET note = newest.text,
    changed_ms = CASE WHEN modes.changed_ms > newest.at_ms THEN modes.changed_ms
        ELSE newest.at_ms END,
    changed_by = CASE WHEN modes.changed_ms > newest.at_ms THEN modes.changed_by
        ELSE newest.author END
FROM triage_notes AS newest
WHERE newest.id IN (
    SELECT max(id) FROM triage_notes WHERE kind = 'mode' GROUP BY parent, number
) AND newest.parent = modes.analysis AND newest.number = modes.number
"""

_GIVE_TRIAGE = """
INSERT INTO triage (kind, parent, number, state, owner, labels, ticket, changed_ms, changed_by)
SELECT 'mode', analysis, number, state, '', '', ticket, changed_ms, changed_by FROM modes
WHERE changed_ms IS NOT NULL
"""

_GIVE_NOTES = """
INSERT INTO triage_notes (kind, parent, number, at_ms, author, text)
SELECT 'mode', analysis, number, changed_ms, changed_by, note FROM modes
WHERE note <> '' ORDER BY analysis, number
"""


def upgrade() -> None:
    """Move triage to the modes; owners, labels, older notes and triage of episodes are lost."""
    for name in ("state", "ticket", "note", "changed_by"):
        default = "new" if name == "state" else ""
        op.add_column("modes", sa.Column(name, sa.Text(), nullable=False, server_default=default))
    op.add_column("modes", sa.Column("changed_ms", sa.BigInteger(), nullable=True))
    op.execute(_TAKE_TRIAGE)
    op.execute(_TAKE_NEWEST_NOTE)
    op.drop_index("ix_triage_notes_kind_parent_number_id", "triage_notes")
    op.drop_table("triage_notes")
    op.drop_table("triage")


def downgrade() -> None:
    """Create the tables with the triage of modes."""
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
    op.execute(_GIVE_TRIAGE)
    op.execute(_GIVE_NOTES)
    for name in _COLUMNS:
        op.drop_column("modes", name)
