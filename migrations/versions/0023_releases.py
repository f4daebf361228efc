"""Version of the planner, project, tags and code of campaigns."""

from collections.abc import Mapping

import msgspec
import sqlalchemy as sa
from alembic import op

revision = "0023"
down_revision = "0022"
branch_labels = None
depends_on = None

COLUMNS = ("planner_version", "project", "tags", "code")
INDEXED = ("planner_version", "project")
VERSIONED = "ix_campaigns_versioned"
FIELDS = COLUMNS[:3]
"""Columns that are also fields of a spec; earlier programs refuse specs with such fields."""

campaigns = sa.table("campaigns", *map(sa.column, ("id", "spec", *FIELDS)))


def upgrade() -> None:
    """Add the columns, with what the specs say: those of earlier releases say nothing of them."""
    for name in COLUMNS:
        op.add_column("campaigns", sa.Column(name, sa.Text()))
    for number, fields in read_specs():
        filled = {name: to_text(fields[name]) for name in FIELDS if name in fields}
        change = sa.update(campaigns).where(campaigns.c.id == number)
        op.get_bind().execute(change.values(**filled))
    for name in INDEXED:
        op.create_index(f"ix_campaigns_{name}_id", "campaigns", [name, "id"])
    has_version = sa.text("planner_version IS NOT NULL")
    op.create_index(
        VERSIONED, "campaigns", ["id"], sqlite_where=has_version, postgresql_where=has_version
    )


def downgrade() -> None:
    """Drop the columns, and the fields of the specs: versions, projects and tags are lost."""
    for number, fields in read_specs():
        kept = {name: value for name, value in fields.items() if name not in FIELDS}
        change = sa.update(campaigns).where(campaigns.c.id == number)
        op.get_bind().execute(change.values(spec=msgspec.json.encode(kept).decode()))
    op.drop_index(VERSIONED, "campaigns")
    for name in INDEXED:
        op.drop_index(f"ix_campaigns_{name}_id", "campaigns")
    for name in COLUMNS:
        op.drop_column("campaigns", name)


def read_specs() -> list[tuple[int, Mapping[str, msgspec.Raw]]]:
    """Return the specs with any of the fields, by id, with the texts of all values."""
    # Names of campaigns have their quotation marks escaped: only the fields are found.
    has_field = sa.or_(*(campaigns.c.spec.contains(f'"{name}":') for name in FIELDS))
    query = sa.select(campaigns.c.id, campaigns.c.spec).where(has_field)
    found = [
        (row.id, msgspec.json.decode(row.spec, type=dict[str, msgspec.Raw]))
        for row in op.get_bind().execute(query)
    ]
    return [(number, fields) for number, fields in found if not fields.keys().isdisjoint(FIELDS)]


def to_text(value: msgspec.Raw) -> str:
    """Return a value as its column holds it: a text as it is, and tags as JSON."""
    found = msgspec.json.decode(value)
    return found if isinstance(found, str) else bytes(value).decode()
