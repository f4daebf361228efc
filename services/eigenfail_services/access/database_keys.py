"""Keys on a database itself, without a service: the way to the first one."""

from contextlib import closing
from pathlib import Path

from eigenfail.rows import Rows
from eigenfail.values.access import ApiKey, AuditEntry, Change, KeyRequest, NewKey
from eigenfail.values.quotas import UNLIMITED, Quotas
from eigenfail.wire.http import PREFIX, read_fields
from eigenfail_services.access.first_key import FirstKey, first_key
from eigenfail_services.access.keys import make_key, revoke_key
from eigenfail_services.store import Store, open_store

MAX_ROWS = 1_000
CREATED, DONE = 201, 200


class DatabaseKeys:
    """The verbs of `Client.keys` for whoever can write the database; the newest 1,000 of a list.

    No key is asked for, and what is changed is noted in the audit log. Every method raises
    ServiceError or InputError where the database, or what was asked for, is not in order.
    """

    def __init__(self, database: str) -> None:
        self._database = database

    def create(
        self, name: str, scope: str, expires_s: int | None = None, quotas: Quotas = UNLIMITED
    ) -> NewKey:
        """Make a key; its token is in the answer, and can never be read again."""
        fields = {"name": name, "scope": scope, "expires_s": expires_s, "quotas": quotas}
        with self._open() as store:
            made = make_key(store, read_fields(fields, KeyRequest))
            _note(store, "POST", "", made.key.id, CREATED)
        return made

    def create_first(self, name: str, file: Path) -> FirstKey:
        """Make an administrator's key in a file, unless there is one."""
        with self._open() as store:
            answer = first_key(store, name, file)
            if answer.made is not None:
                _note(store, "POST", "", answer.made.id, CREATED)
        return answer

    def get(self, key: int) -> ApiKey:
        """A key, without its secret."""
        with self._open() as store:
            return store.keys.find(key).key

    def limit(self, key: int, quotas: Quotas) -> ApiKey:
        """Give a key these quotas from now on; what was made before stays, and counts."""
        with self._open() as store:
            limited = store.keys.limit(key, quotas)
            _note(store, "POST", "/{key}/quotas", limited.id, DONE)
        return limited

    def list(self) -> Rows[ApiKey]:
        """Keys, newest first; those that are no longer valid, too."""
        with self._open() as store:
            page = store.keys.page(MAX_ROWS)
        return Rows(lambda: iter(page.items))

    def revoke(self, key: int) -> ApiKey:
        """Revoke a key, for good."""
        with self._open() as store:
            revoked = revoke_key(store, key)
            _note(store, "DELETE", "/{key}", revoked.id, DONE)
        return revoked

    def audit(self) -> Rows[AuditEntry]:
        """Who changed what, newest first."""
        with self._open() as store:
            page = store.audit.page(MAX_ROWS)
        return Rows(lambda: iter(page.items))

    def _open(self) -> "closing[Store]":
        return closing(open_store(self._database, migrate=False))


def _note(store: Store, method: str, path: str, key: int, status: int) -> None:
    """Write a line of the audit log, as the API would have written it."""
    route = f"{PREFIX}/keys"
    change = Change("database", None, method, f"{route}{path}", f"{route}/{key}", "", status)
    store.audit.append(change)
