"""Keys on a database itself, without a service: the way to the first one."""

from typing import TypeVar

import msgspec

from eigenfail.hosting.service import services_tool
from eigenfail.rows import Rows
from eigenfail.values import Page
from eigenfail.values.access import ApiKey, AuditEntry, NewKey

Kind = TypeVar("Kind")


class DatabaseKeys:
    """The verbs of `Client.keys` for whoever can write the database; the newest 1,000 of a list.

    Every method raises ServiceError or InputError where the database, or what was asked for, is
    not in order.
    """

    def __init__(self, database: str) -> None:
        self._database = database

    def create(self, name: str, scope: str, expires_s: int | None = None) -> NewKey:
        """Make a key; its token is in the answer, and can never be read again."""
        life = [] if expires_s is None else [f"--expires-s={expires_s}"]
        return self._said(NewKey, "create", f"--name={name}", f"--scope={scope}", *life)

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
