"""Failure modes as rows: a name for each, and the failures that belong to it."""

from collections.abc import Iterator
from textwrap import shorten
from typing import Any

import msgspec
import sqlalchemy as sa
from alembic import op

revision = "0022"
down_revision = "0021"
branch_labels = None
depends_on = None

BATCH = 1_000


def upgrade() -> None:
    """Create the tables, and fill them from the results of earlier analyses."""
    number = sa.BigInteger().with_variant(sa.Integer(), "sqlite")
    op.create_table(
        "modes",
        sa.Column("analysis", number, nullable=False, autoincrement=False),
        sa.Column("number", sa.Integer(), nullable=False, autoincrement=False),
        sa.Column("failures", sa.Integer(), nullable=False),
        sa.Column("name", sa.Text(), nullable=False),
        sa.PrimaryKeyConstraint("analysis", "number", name="pk_modes"),
        sa.ForeignKeyConstraint(["analysis"], ["analyses.id"], name="fk_modes_analysis"),
    )
    op.create_table(
        "mode_members",
        sa.Column("campaign", number, nullable=False, autoincrement=False),
        sa.Column("analysis", number, nullable=False, autoincrement=False),
        sa.Column("index", number, nullable=False, autoincrement=False),
        sa.Column("number", sa.Integer(), nullable=False),
        sa.PrimaryKeyConstraint("campaign", "analysis", "index", name="pk_mode_members"),
        sa.ForeignKeyConstraint(["campaign"], ["campaigns.id"], name="fk_mode_members_campaign"),
        sa.ForeignKeyConstraint(["analysis"], ["analyses.id"], name="fk_mode_members_analysis"),
    )
    op.create_index("ix_mode_members_analysis_number", "mode_members", ["analysis", "number"])
    _fill()


def _fill() -> None:
    connection = op.get_bind()
    modes, members = (
        sa.table(name, *map(sa.column, columns))
        for name, columns in (
            ("modes", ("analysis", "number", "failures", "name")),
            ("mode_members", ("campaign", "analysis", "index", "number")),
        )
    )
    done = sa.text("SELECT id, campaign FROM analyses WHERE state = 'done'")
    for analysis, campaign in connection.execute(done).all():
        blob = sa.text("SELECT result FROM analyses WHERE id = :id")
        packed = connection.execute(blob, {"id": analysis}).scalar()
        if packed is None:
            continue
        result = msgspec.msgpack.decode(packed)
        rows = [*_list_members(analysis, campaign, result)]
        for first in range(0, len(rows), BATCH):
            connection.execute(sa.insert(members), rows[first : first + BATCH])
        sizes = [mode["failures"] for mode in result["modes"]]
        words = [*result.get("words", ()), *[""] * len(sizes)]
        named = [
            {
                "analysis": analysis,
                "number": number,
                "failures": failures,
                "name": _propose_name(number, sentence),
            }
            for number, (failures, sentence) in enumerate(zip(sizes, words, strict=False), start=1)
        ]
        if named:
            connection.execute(sa.insert(modes), named)


def _propose_name(number: int, words: str) -> str:
    sentence = words.removeprefix(f"Mode {number}: ").split(". ")[0].removesuffix(".")
    return shorten(sentence, 80, placeholder=" …") or f"Mode {number}"


def _list_members(analysis: int, campaign: int, result: dict[str, Any]) -> Iterator[dict[str, int]]:
    indices = result["episodes"]
    owners = result.get("campaigns") or [campaign] * len(indices)
    for owner, index, label in zip(owners, indices, result["labels"], strict=True):
        yield {"campaign": owner, "analysis": analysis, "index": index, "number": label + 1}


def downgrade() -> None:
    """Drop the tables; names of modes are lost."""
    op.drop_index("ix_mode_members_analysis_number", "mode_members")
    op.drop_table("mode_members")
    op.drop_table("modes")
