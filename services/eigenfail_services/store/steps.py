"""Alembic's part of a migration; apart, because most starts need none of it."""

from alembic import command
from alembic.config import Config
from alembic.script import ScriptDirectory
from sqlalchemy import Connection

from eigenfail.errors import SchemaMismatch
from eigenfail_services.store import migrate
from eigenfail_services.store.schema import VERSION


def configured(connection: Connection | None = None) -> Config:
    """Alembic's settings: where the migrations are, and the transaction that they run in."""
    config = Config()
    config.set_main_option("script_location", str(migrate.folder()).replace("%", "%%"))
    config.attributes["connection"] = connection
    return config


def revisions() -> list[str]:
    """All that this program knows, oldest first."""
    script = ScriptDirectory.from_config(configured())
    return [revision.revision for revision in script.walk_revisions()][::-1]


def refuse_newer(version: str | None, label: str) -> None:
    """Leave alone what a later program made.

    Raises:
        SchemaMismatch: no migration of this program leads to that version.
    """
    if version is not None and version not in revisions():
        raise SchemaMismatch(
            f"The schema of {label} is {version}, newer than this program's {VERSION}.",
            "Update eigenfail, or use another database; this one was left as it is.",
        )


def upgrade(connection: Connection) -> None:
    """Run every migration that is missing."""
    command.upgrade(configured(connection), "head")


def downgrade(connection: Connection, revision: str) -> None:
    """Undo migrations down to a revision."""
    command.downgrade(configured(connection), revision)
