"""How migrations run: in one transaction, on SQLite and PostgreSQL alike."""

from contextlib import AbstractContextManager, nullcontext
from typing import Any, Literal

from alembic import context
from alembic.autogenerate.api import AutogenContext
from sqlalchemy import Connection

from eigenfail_services.store.engine import find_backend
from eigenfail_services.store.migrate import schema_transaction
from eigenfail_services.store.schema import PLUGIN_PREFIX, VERSION_TABLE, Number, Prose, metadata


def transaction() -> AbstractContextManager[Connection]:
    """The program's own, or, under Alembic's command line, one on `-x database=…`."""
    given = context.config.attributes.get("connection")
    if given is not None:
        return nullcontext(given)
    return schema_transaction(find_backend(context.get_x_argument(as_dictionary=True)["database"]))


# Migrations outlive the program's own types: they write what the database has.
RENDERED = {Prose: "sa.Text()", Number: 'sa.BigInteger().with_variant(sa.Integer(), "sqlite")'}


def rendered(_kind: str, item: Any, _context: AutogenContext) -> str | Literal[False]:
    return RENDERED.get(type(item), False)


def included(name: str | None, kind: str, _parents: object) -> bool:
    # Plug-ins create their tables themselves.
    return kind != "table" or not (name or "").startswith(PLUGIN_PREFIX)


with transaction() as connection:
    context.configure(
        connection=connection,
        target_metadata=metadata,
        version_table=VERSION_TABLE,
        render_as_batch=True,
        render_item=rendered,
        include_name=included,
    )
    with context.begin_transaction():
        context.run_migrations()
