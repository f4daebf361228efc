"""Keys and the audit log in SQL."""

from collections.abc import Sequence
from typing import Any

from msgspec.structs import asdict
from sqlalchemy import ColumnElement, RowMapping, Select, delete, func, insert, select, update

from eigenfail.values import Page
from eigenfail.values.access import ApiKey, AuditEntry, Change, KeyRecord, Scope
from eigenfail.values.quotas import UNLIMITED, Quotas, Usage
from eigenfail_services.store import limits
from eigenfail_services.store.clock import now_ms
from eigenfail_services.store.engine import Database
from eigenfail_services.store.quotas import QUOTAS, used_by
from eigenfail_services.store.refusals import no_key
from eigenfail_services.store.schema import audit, keys

PRUNED_EVERY = 1_000

SHOWN = tuple(column for column in keys.c if column is not keys.c.digest)


class SqlKeys:
    """Keys of the API."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def create(
        self,
        name: str,
        scope: Scope,
        digest: str,
        expires_ms: int | None = None,
        quotas: Quotas = UNLIMITED,
    ) -> ApiKey:
        """A new key, of whose secret only the digest is kept."""
        values = {"name": name, "scope": scope.value, "digest": digest, "expires_ms": expires_ms}
        made = insert(keys).values(created_ms=now_ms(), **values, **asdict(quotas))
        statement = made.returning(*SHOWN)
        with self._database.writing() as connection:
            return _key(connection.execute(statement).mappings().one())

    def find(self, key: int) -> KeyRecord:
        """A key with the digest of its secret."""
        with self._database.reading() as connection:
            found = connection.execute(select(keys).where(keys.c.id == key)).mappings().first()
        if found is None:
            raise no_key(key)
        values = dict(found)
        digest = values.pop("digest")
        return KeyRecord(_key(values), digest)

    def page(self, limit: int, before: int | None = None) -> Page[ApiKey]:
        """Keys, newest first, with ids below `before`."""
        query = newest(select(*SHOWN), keys.c.id, limit, before)
        with self._database.reading() as connection:
            found = [_key(row) for row in connection.execute(query).mappings()]
        return Page(tuple(found[:limit]), found[limit - 1].id if len(found) > limit else None)

    def revoke(self, key: int) -> ApiKey:
        """It opens nothing any more; a second time changes nothing."""
        return self._change(key, revoked_ms=func.coalesce(keys.c.revoked_ms, now_ms()))

    def limit(self, key: int, quotas: Quotas) -> ApiKey:
        """From now on it has these quotas; what was made before stays."""
        return self._change(key, **asdict(quotas))

    def usage(self, wanted: Sequence[int]) -> dict[int, Usage]:
        """What the campaigns of each key use now."""
        with self._database.reading() as connection:
            return used_by(connection, wanted)

    def _change(self, key: int, **values: Any) -> ApiKey:
        change = update(keys).where(keys.c.id == key).values(**values).returning(*SHOWN)
        with self._database.writing() as connection:
            found = connection.execute(change).mappings().first()
        if found is None:
            raise no_key(key)
        return _key(found)

    def used(self, key: int, at_ms: int) -> None:
        """Remember when it was last used."""
        with self._database.writing() as connection:
            connection.execute(update(keys).where(keys.c.id == key).values(last_used_ms=at_ms))

    def exist(self) -> bool:
        """Whether a key was ever made."""
        with self._database.reading() as connection:
            return connection.execute(select(keys.c.id).limit(1)).first() is not None

    def admins(self, at_ms: int) -> int:
        """How many keys for administrators are valid at a moment."""
        valid = keys.c.revoked_ms.is_(None) & (
            keys.c.expires_ms.is_(None) | (keys.c.expires_ms > at_ms)
        )
        query = select(func.count()).where(keys.c.scope == Scope.ADMIN.value, valid)
        with self._database.reading() as connection:
            return int(connection.execute(query).scalar_one())


class SqlAuditLog:
    """Keeps the newest changes; older ones are forgotten."""

    def __init__(self, database: Database) -> None:
        self._database = database

    def append(self, change: Change) -> AuditEntry:
        """Write down a change, with the time."""
        values, at_ms = asdict(change), now_ms()
        statement = insert(audit).values(at_ms=at_ms, **values).returning(audit.c.id)
        with self._database.writing() as connection:
            number: int = connection.execute(statement).scalar_one()
            if number % PRUNED_EVERY == 0:
                oldest = number - limits.KEPT_CHANGES
                connection.execute(delete(audit).where(audit.c.id <= oldest))
        return AuditEntry(**values, id=number, at_ms=at_ms)

    def page(self, limit: int, before: int | None = None) -> Page[AuditEntry]:
        """Changes, newest first, with ids below `before`."""
        query = newest(select(audit), audit.c.id, limit, before)
        with self._database.reading() as connection:
            found = [AuditEntry(**row) for row in connection.execute(query).mappings()]
        return Page(tuple(found[:limit]), found[limit - 1].id if len(found) > limit else None)


def newest(
    query: Select[Any], number: ColumnElement[int], limit: int, before: int | None
) -> Select[Any]:
    """One row more than a page has, with numbers below `before`."""
    ordered = query.order_by(number.desc()).limit(limit + 1)
    return ordered if before is None else ordered.where(number < before)


def _key(found: RowMapping | dict[str, Any]) -> ApiKey:
    values: dict[str, Any] = dict(found)
    quotas = Quotas(**{name: values.pop(name) for name in QUOTAS})
    return ApiKey(scope=Scope(values.pop("scope")), quotas=quotas, **values)
