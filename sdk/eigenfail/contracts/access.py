"""What remembers who may do what, and who did what."""

from collections.abc import Sequence
from typing import Protocol

from eigenfail.values import Page
from eigenfail.values.access import ApiKey, AuditEntry, Change, KeyRecord, Scope
from eigenfail.values.quotas import UNLIMITED, Quotas, Usage


class KeyStore(Protocol):
    """Keys of the API. None is ever forgotten, so that the audit log can be read."""

    def create(
        self,
        name: str,
        scope: Scope,
        digest: str,
        expires_ms: int | None = None,
        quotas: Quotas = UNLIMITED,
    ) -> ApiKey:
        """A new key, of whose secret only the digest is kept."""

    def find(self, key: int) -> KeyRecord:
        """A key with the digest of its secret.

        Raises:
            NotFound: no such key.
        """

    def page(self, limit: int, before: int | None = None) -> Page[ApiKey]:
        """Keys, newest first, with ids below `before`; those that are no longer valid, too."""

    def revoke(self, key: int) -> ApiKey:
        """It opens nothing any more; a second time changes nothing.

        Raises:
            NotFound: no such key.
        """

    def limit(self, key: int, quotas: Quotas) -> ApiKey:
        """From now on it has these quotas; what was made before stays.

        Raises:
            NotFound: no such key.
        """

    def usage(self, wanted: Sequence[int]) -> dict[int, Usage]:
        """What the campaigns of each key use of its quotas; nothing of a key that made none."""

    def used(self, key: int, at_ms: int) -> None:
        """Remember when it was last used; nothing, where there is no such key."""

    def exist(self) -> bool:
        """Whether a key was ever made."""

    def admins(self, at_ms: int) -> int:
        """How many keys for administrators are valid at a moment."""


class AuditLog(Protocol):
    """Who changed what."""

    def append(self, change: Change) -> AuditEntry:
        """Write down a change, with the time."""

    def page(self, limit: int, before: int | None = None) -> Page[AuditEntry]:
        """Changes, newest first, with ids below `before`."""
