"""Keys and the audit log in memory."""

from collections.abc import Sequence
from typing import TypeVar

from msgspec.structs import asdict, replace

from eigenfail.values import Page
from eigenfail.values.access import ApiKey, AuditEntry, Change, KeyRecord, Scope
from eigenfail.values.quotas import UNLIMITED, Quotas, Usage
from eigenfail_services.store import limits
from eigenfail_services.store.clock import now_ms
from eigenfail_services.store.memory.quotas import used_by
from eigenfail_services.store.memory.tables import Tables
from eigenfail_services.store.refusals import no_key

Item = TypeVar("Item", ApiKey, AuditEntry)


class MemoryKeys:
    """Keys of the API."""

    def __init__(self, tables: Tables) -> None:
        self._tables = tables
        self._records = tables.records

    def create(
        self,
        name: str,
        scope: Scope,
        digest: str,
        expires_ms: int | None = None,
        quotas: Quotas = UNLIMITED,
    ) -> ApiKey:
        """A new key, of whose secret only the digest is kept."""
        with self._tables.lock:
            number = len(self._records) + 1
            key = ApiKey(number, name, scope, now_ms(), expires_ms, quotas=quotas)
            self._records[key.id] = KeyRecord(key, digest)
        return key

    def find(self, key: int) -> KeyRecord:
        """A key with the digest of its secret."""
        with self._tables.lock:
            if key not in self._records:
                raise no_key(key)
            return self._records[key]

    def page(self, limit: int, before: int | None = None) -> Page[ApiKey]:
        """Keys, newest first, with ids below `before`."""
        with self._tables.lock:
            return newest([record.key for record in self._records.values()], limit, before)

    def revoke(self, key: int) -> ApiKey:
        """It opens nothing any more; a second time changes nothing."""
        with self._tables.lock:
            seen = self.find(key).key
            return self._keep(replace(seen, revoked_ms=seen.revoked_ms or now_ms()))

    def limit(self, key: int, quotas: Quotas) -> ApiKey:
        """From now on it has these quotas; what was made before stays."""
        with self._tables.lock:
            return self._keep(replace(self.find(key).key, quotas=quotas))

    def usage(self, wanted: Sequence[int]) -> dict[int, Usage]:
        """What the campaigns of each key use now."""
        with self._tables.lock:
            return {key: used_by(self._tables, key) for key in wanted}

    def used(self, key: int, at_ms: int) -> None:
        """Remember when it was last used."""
        with self._tables.lock:
            if key in self._records:
                self._keep(replace(self._records[key].key, last_used_ms=at_ms))

    def exist(self) -> bool:
        """Whether a key was ever made."""
        return bool(self._records)

    def admins(self, at_ms: int) -> int:
        """How many keys for administrators are valid at a moment."""
        with self._tables.lock:
            found = [record.key for record in self._records.values()]
        return sum(key.scope is Scope.ADMIN and key.is_valid(at_ms) for key in found)

    def _keep(self, key: ApiKey) -> ApiKey:
        self._records[key.id] = replace(self._records[key.id], key=key)
        return key


class MemoryAuditLog:
    """Keeps the newest changes; older ones are forgotten."""

    def __init__(self, tables: Tables) -> None:
        self._tables = tables
        self._entries: dict[int, AuditEntry] = {}
        self._last = 0

    def append(self, change: Change) -> AuditEntry:
        """Write down a change, with the time."""
        with self._tables.lock:
            self._last += 1
            entry = AuditEntry(**asdict(change), id=self._last, at_ms=now_ms())
            self._entries[entry.id] = entry
            self._entries.pop(entry.id - limits.KEPT_CHANGES, None)
        return entry

    def page(self, limit: int, before: int | None = None) -> Page[AuditEntry]:
        """Changes, newest first, with ids below `before`."""
        with self._tables.lock:
            return newest([*self._entries.values()], limit, before)


def newest(items: list[Item], limit: int, before: int | None) -> Page[Item]:
    """A page of what has rising ids, the last one first."""
    found = [item for item in reversed(items) if before is None or item.id < before]
    return Page(tuple(found[:limit]), found[limit - 1].id if len(found) > limit else None)
