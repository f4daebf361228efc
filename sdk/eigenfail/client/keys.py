"""Keys of a service, and the audit log, for administrators."""

import os

from eigenfail.client.link import Link
from eigenfail.errors import InvalidValue
from eigenfail.rows import Rows
from eigenfail.values import Page
from eigenfail.values.access import TOKEN, ApiKey, AuditEntry, KeyRequest, NewKey, Scope
from eigenfail.values.quotas import UNLIMITED, Quotas, Usage
from eigenfail.wire.http import read_fields

KEY_VARIABLE = "EIGENFAIL_KEY"


class Keys:
    """Make, list, limit and revoke keys.

    Every method raises Unauthorized without a valid key, Forbidden without one of the scope admin,
    and ServiceUnreachable if no service answers.
    """

    def __init__(self, link: Link) -> None:
        self._link = link

    def create(
        self,
        name: str,
        scope: Scope | str = Scope.VIEWER,
        expires_s: int | None = None,
        quotas: Quotas = UNLIMITED,
    ) -> NewKey:
        """Make a key; its token is in the answer, and can never be read again.

        Args:
            name: who or what it is for.
            scope: viewer reads, runner also starts and steers, admin does everything.
            expires_s: for how long it is valid [s]; None: until it is revoked.
            quotas: how much may be done with it.

        Raises:
            InvalidValue: a value outside its bounds; or a first key that is no administrator's.
        """
        wanted = {"name": name, "scope": scope, "expires_s": expires_s, "quotas": quotas}
        return self._link.post("/keys", NewKey, read_fields(wanted, KeyRequest))

    def list(self) -> Rows[ApiKey]:
        """All keys, newest first; those that are no longer valid, too."""
        return self._link.pages("/keys", Page[ApiKey], "before")

    def get(self, key: int) -> ApiKey:
        """A key, without its secret.

        Raises:
            NotFound: no such key.
        """
        return self._link.get(f"/keys/{key}", ApiKey)

    def usage(self, key: int) -> Usage:
        """What the campaigns of a key use of its quotas now.

        Raises:
            NotFound: no such key.
        """
        return self._link.get(f"/keys/{key}/usage", Usage)

    def limit(self, key: int, quotas: Quotas) -> ApiKey:
        """Give a key these quotas from now on; what was made before stays, and counts.

        Raises:
            NotFound: no such key.
        """
        return self._link.post(f"/keys/{key}/quotas", ApiKey, quotas)

    def revoke(self, key: int) -> ApiKey:
        """Revoke a key, for good.

        Raises:
            NotFound: no such key.
        """
        return self._link.delete(f"/keys/{key}", ApiKey)

    def audit(self) -> Rows[AuditEntry]:
        """Who changed what, newest first."""
        return self._link.pages("/audit", Page[AuditEntry], "before")


def token_of(given: str | None) -> str | None:
    """The key that was given, or else that of the environment, if there is one.

    Raises:
        InvalidValue: it does not look like one; what was given is not repeated.
    """
    token = (os.environ.get(KEY_VARIABLE, "") if given is None else given).strip()
    if token and TOKEN.fullmatch(token) is None:
        raise InvalidValue(
            "key",
            "what was given is not of the form ef_ID_SECRET.",
            f"Look at {KEY_VARIABLE}, or at what was given as `key`; "
            "`eigenfail key create` makes keys.",
        )
    return token or None
