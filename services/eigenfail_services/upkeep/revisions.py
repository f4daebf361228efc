"""The way back to an older schema, for whoever must go back to an older program."""

import sqlite3
from collections.abc import Callable, Mapping
from contextlib import closing
from pathlib import Path

from sqlalchemy import URL, make_url

from eigenfail.errors import Conflict, ServiceError, UnknownName
from eigenfail_services.store import migrate, steps
from eigenfail_services.store.engine import Database, find
from eigenfail_services.upkeep.dumps import OTHERS
from eigenfail_services.upkeep.sqlite_files import WAIT_S, troubles


def downgrade(address: str, revision: str, *, force: bool) -> str:
    """Take a database back to an older schema: all of the way, or nothing is changed.

    Args:
        address: of the database, which nobody may use meanwhile.
        revision: where to.
        force: whether what only newer schemas hold may go.

    Returns:
        The revision that it has then.

    Raises:
        InvalidValue: the address is none.
        UnknownName: no such revision.
        StoreUnavailable: there is no database, or it does not answer.
        SchemaMismatch: its schema is that of a newer program.
        Conflict: it is as old already; or something would be lost.
        ServiceError: somebody uses it.
    """
    found = migrate.current(address)
    steps.refuse_newer(found, find(address).label)
    refuse_the_wrong_way(found, revision)
    if not force:
        raise Conflict(
            f"From {found} back to {revision}, all that only newer schemas hold is lost.",
            "Make a backup first: eigenfail db backup FILE. Then say --force.",
        )
    url = make_url(address)
    REFUSALS[url.get_backend_name()](url)
    migrate.downgrade(address, revision)
    return revision


def refuse_the_wrong_way(found: str | None, revision: str) -> None:
    """Raises UnknownName, or Conflict where a revision is no older one."""
    known = steps.revisions()
    if revision not in known:
        raise UnknownName("to", revision, known)
    if found is None or known.index(revision) >= known.index(found):
        raise Conflict(
            f"The schema is {found or 'empty'}, which is not newer than {revision}.",
            "`eigenfail db upgrade` brings a schema forward.",
        )


def refuse_company_in_file(url: URL) -> None:
    """Raises ServiceError where somebody else has the file open."""
    path = Path(str(url.database)).absolute()
    with (
        troubles(f"{path} was left as it is"),
        closing(sqlite3.connect(path, timeout=WAIT_S)) as connection,
    ):
        # Refused unless nobody else has it open; the next program turns it back.
        connection.execute("PRAGMA journal_mode = DELETE")


def refuse_company_at_server(url: URL) -> None:
    """Raises ServiceError where a program of ours is connected."""
    backend = find(url.render_as_string(hide_password=False))
    with closing(Database(backend)) as database, database.reading() as connection:
        if connection.execute(OTHERS).scalar_one():
            raise ServiceError(f"A service uses {backend.label}.", "Stop it, and try again.")


REFUSALS: Mapping[str, Callable[[URL], None]] = {
    "sqlite": refuse_company_in_file,
    "postgresql": refuse_company_at_server,
    "postgres": refuse_company_at_server,
}
