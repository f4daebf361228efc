"""From an address to a store."""

from contextlib import ExitStack

from eigenfail.contracts import Store
from eigenfail_services.store import migrate as schema
from eigenfail_services.store.engine import Backend, Database, find, translated
from eigenfail_services.store.memory import MemoryStore
from eigenfail_services.store.sql import SqlStore

MEMORY = "memory://"


def open_store(url: str, *, migrate: bool = True) -> Store:
    """The store at an address.

    An empty database gets its tables, and one of an older release is upgraded: all of the way or
    not at all.

    Args:
        url: sqlite:///folder/file.db, postgresql://user:password@host:5432/database, or memory://
            for one that is gone with the process.
        migrate: whether the schema may be changed; if not, anything but the newest is refused.

    Raises:
        InvalidValue: it is no address of a database that is supported.
        StoreUnavailable: nothing can be read or written there, within about five seconds; or
            there is nothing and it may not be made.
        SchemaMismatch: the schema is newer than this program, somebody else's, or may not be
            changed.
    """
    if url == MEMORY:
        return MemoryStore()
    return SqlStore(open_database(find(url), migrate=migrate))


def open_database(backend: Backend, *, migrate: bool) -> Database:
    """The same without the store that is built upon it."""
    if migrate:
        with translated(backend):
            backend.prepare()
    else:
        backend.require()
    database = Database(backend)
    with ExitStack() as undo:
        undo.callback(database.close)
        schema.ensure(database, backend, migrate=migrate)
        undo.pop_all()
    return database
