"""Keys on a database itself, without a service: the way to the first one."""

from collections.abc import Iterator
from typing import TypeVar

import msgspec

from eigenfail.hosting.service import services_tool
from eigenfail.rows import Rows
from eigenfail.values import Page
from eigenfail.values.access import ApiKey, AuditEntry, NewKey
from eigenfail.values.quotas import UNLIMITED, Quotas

Kind = TypeVar("Kind")


class DatabaseKeys:
    """The verbs of `Client.keys` for whoever can write the database; the newest 1,000 of a list.

    Every method raises ServiceError or InputError where the database, or what was asked for, is
    not in order.
    """

    def __init__(self, database: str) -> None:
        self._database = database

    def create(
        self, name: str, scope: str, expires_s: int | None = None, quotas: Quotas = UNLIMITED
    ) -> NewKey:
        """Make a key; its token is in the answer, and can never be read again."""
        life = [] if expires_s is None else [f"--expires-s={expires_s}"]
        wanted = (f"--name={name}", f"--scope={scope}", *life, *words(quotas))
        return self._said(NewKey, "create", *wanted)

    def get(self, key: int) -> ApiKey:
        """A key, without its secret."""
        return self._said(ApiKey, "show", f"--key={key}")

    def limit(self, key: int, quotas: Quotas) -> ApiKey:
        """Give a key these quotas from now on; what was made before stays, and counts."""
        return self._said(ApiKey, "limit", f"--key={key}", *words(quotas))

    def list(self) -> Rows[ApiKey]:
        """Keys, newest first; those that are no longer valid, too."""
        return Rows(lambda: iter(self._said(Page[ApiKey], "list").items))

    def revoke(self, key: int) -> ApiKey:
        """Revoke a key, for good."""
        return self._said(ApiKey, "revoke", f"--key={key}")

    def audit(self) -> Rows[AuditEntry]:
        """Who changed what, newest first."""
        return Rows(lambda: iter(self._said(Page[AuditEntry], "audit").items))

    def _said(self, kind: type[Kind], *words: str) -> Kind:
        return msgspec.json.decode(services_tool(("key", *words), self._database), type=kind)


def words(quotas: Quotas) -> Iterator[str]:
    """Quotas on a command line."""
    for name, limit in msgspec.structs.asdict(quotas).items():
        if limit is not None:
            yield f"--{name.replace('_', '-')}={limit}"
