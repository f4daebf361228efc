"""Keys of the API, their quotas, and the audit log."""

from collections.abc import Iterator, Sequence
from typing import Any, NamedTuple

import sqlalchemy as sa
from msgspec.structs import asdict

from eigenfail.errors import QuotaExceeded
from eigenfail.values import access
from eigenfail.values.campaign_spec import CampaignSpec
from eigenfail.values.records import Page
from eigenfail_services.store.clock import now_ms
from eigenfail_services.store.codec import StructRows
from eigenfail_services.store.engine import StorePart
from eigenfail_services.store.errors import make_key_error
from eigenfail_services.store.schema import audit, campaigns, keys

DAY_MS = 24 * 3_600_000


class Demand(NamedTuple):
    """The amount of one quota that a request needs.

    Attributes:
        quota: its name.
        limit: how much it allows; None: everything.
        used: the part of the quota that is used.
        more: the requested amount.
        what: the things that it counts, in words.
        remedy: a way to get more room.
    """

    quota: str
    limit: int | None
    used: int
    more: int
    what: str
    remedy: str


def refuse_beyond(
    key: int, name: str, quotas: access.Quotas, usage: access.Usage, specs: Sequence[CampaignSpec]
) -> None:
    """Refuse campaigns that would exceed the quotas of a key.

    Raises:
        QuotaExceeded: the campaigns need more than the key allows; the error names the quota.
    """
    for demand in list_demands(quotas, usage, [spec.episodes for spec in specs]):
        if demand.limit is not None and demand.used + demand.more > demand.limit:
            raise make_quota_error(key, name, demand)


def list_demands(
    quotas: access.Quotas, usage: access.Usage, episodes: Sequence[int]
) -> Iterator[Demand]:
    """Yield the demand on each quota of campaigns with the given budgets."""
    yield Demand(
        "max_episodes",
        quotas.max_episodes,
        0,
        max(episodes, default=0),
        "episodes in one campaign",
        "Ask for fewer episodes",
    )
    yield Demand(
        "max_open",
        quotas.max_open,
        usage.open,
        len(episodes),
        "campaigns at once that have not ended",
        "Wait until one ends, or cancel one",
    )
    yield Demand(
        "max_episodes_per_day",
        quotas.max_episodes_per_day,
        usage.episodes_of_day,
        sum(episodes),
        "episodes in the campaigns of 24 hours",
        "Ask for fewer, cancel a campaign that is not needed, or wait",
    )


def make_quota_error(key: int, name: str, demand: Demand) -> QuotaExceeded:
    """Return the error of an exhausted quota: its name, limit and usage, and the remedy."""
    command = f"eigenfail key limit {key} --{demand.quota.replace('_', '-')} N"
    return QuotaExceeded(
        f"Key {key} '{name}' may have {demand.limit:,} {demand.what} ({demand.quota}); "
        f"{demand.used:,} are used, and this asks for {demand.more:,}.",
        f"{demand.remedy}. An administrator can allow more: `{command}`.",
    )


_LIMITS = sa.select(keys.c.name, *(keys.c[name] for name in access.Quotas.__struct_fields__))


def admit_campaigns(
    connection: sa.Connection, key: int | None, specs: Sequence[CampaignSpec]
) -> None:
    """Check the demand of new campaigns against the quotas of a key; None means no quotas.

    The key stays locked until the transaction ends.

    Raises:
        QuotaExceeded: the campaigns need more than the key allows.
    """
    if key is None:
        return
    # Without this lock two simultaneous requests would each see only the earlier campaigns, and
    # exceed the quota together.
    found = connection.execute(_LIMITS.where(keys.c.id == key).with_for_update()).first()
    if found is None:
        return
    name, *limits = found
    if (quotas := access.Quotas(*limits)) != access.UNLIMITED:
        refuse_beyond(key, name, quotas, count_usage(connection, [key])[key], specs)


def count_usage(connection: sa.Connection, wanted: Sequence[int]) -> dict[int, access.Usage]:
    """Return the present usage of the quotas of each key."""
    nothing = dict.fromkeys(wanted, access.Usage())
    found = connection.execute(_select_usage(wanted, now_ms() - DAY_MS)).all()
    return nothing | {row.made_by: access.Usage(int(row.open), int(row.episodes)) for row in found}


def _select_usage(wanted: Sequence[int], since_ms: int) -> sa.Select[Any]:
    is_open = campaigns.c.ended_ms.is_(None)
    is_new = campaigns.c.created_ms > since_ms
    # Episodes that were left unrun when a campaign ended are counted as cancelled, and do not use
    # up the quota.
    episodes = sa.case((is_new, campaigns.c.planned - campaigns.c.cancelled), else_=0)
    return (
        sa.select(
            campaigns.c.made_by,
            sa.func.sum(sa.case((is_open, 1), else_=0)).label("open"),
            sa.func.sum(episodes).label("episodes"),
        )
        .where(campaigns.c.made_by.in_(wanted), is_open | is_new)
        .group_by(campaigns.c.made_by)
    )


KEPT_CHANGES = 1_000_000
"""Lines of the audit log; older ones are deleted."""


# Deleting old lines is a second statement. It runs with every thousandth line, so the log may be
# longer than its limit by as many.
PRUNED_EVERY = 1_000


_KEYS = StructRows(keys, access.ApiKey)
_CHANGES = StructRows(audit, access.AuditEntry)


class KeyStore(StorePart):
    """Keys of the API. None is ever deleted, so that the audit log stays readable."""

    def create(
        self,
        name: str,
        scope: access.Scope,
        digest: str,
        expires_ms: int | None = None,
        quotas: access.Quotas = access.UNLIMITED,
    ) -> access.ApiKey:
        """Create a key; of its secret only the digest is stored."""
        values = {"name": name, "scope": scope.value, "digest": digest, "expires_ms": expires_ms}
        statement = (
            sa.insert(keys)
            .values(created_ms=now_ms(), **values, **asdict(quotas))
            .returning(*_KEYS.columns)
        )
        with self._database.writing() as connection:
            (made,) = _KEYS.list(connection, statement)
        return made

    def find(self, key: int) -> access.KeyRecord:
        """Return a key with the digest of its secret.

        Raises:
            NotFound: no such key.
        """
        query = sa.select(keys).where(keys.c.id == key)
        with self._database.reading() as connection:
            found = connection.execute(query).mappings().first()
        if found is None:
            raise make_key_error(key)
        return access.KeyRecord(_KEYS.read(found), found["digest"])

    def page(self, limit: int, before: int | None = None) -> Page[access.ApiKey]:
        """Return keys, newest first, with ids below `before`, with revoked and expired ones."""
        return self._database.read(_KEYS.page, limit, before)

    def revoke(self, key: int) -> access.ApiKey:
        """Revoke a key; a second time changes nothing.

        Raises:
            NotFound: no such key.
        """
        return self._change(key, revoked_ms=sa.func.coalesce(keys.c.revoked_ms, now_ms()))

    def limit(self, key: int, quotas: access.Quotas) -> access.ApiKey:
        """Set the quotas of a key; campaigns that exist are not affected.

        Raises:
            NotFound: no such key.
        """
        return self._change(key, **asdict(quotas))

    def usage(self, wanted: Sequence[int]) -> dict[int, access.Usage]:
        """Return how much of its quotas each key uses, 0 for a key without campaigns."""
        return self._database.read(count_usage, wanted)

    def _change(self, key: int, **values: Any) -> access.ApiKey:
        change = sa.update(keys).where(keys.c.id == key).values(**values)
        with self._database.writing() as connection:
            found = _KEYS.first(connection, change.returning(*_KEYS.columns))
        if found is None:
            raise make_key_error(key)
        return found

    def used(self, key: int, at_ms: int) -> None:
        """Record when a key was last used; an unknown key is ignored."""
        with self._database.writing() as connection:
            connection.execute(sa.update(keys).where(keys.c.id == key).values(last_used_ms=at_ms))

    def exist(self) -> bool:
        """Return whether a key was ever created."""
        with self._database.reading() as connection:
            # Revoked and expired keys count, too: a service must not open to everybody when its
            # last key ends.
            return connection.execute(sa.select(keys.c.id).limit(1)).first() is not None

    def admins(self, at_ms: int) -> int:
        """Count the administrators' keys that are valid at a moment."""
        valid = keys.c.revoked_ms.is_(None) & (
            keys.c.expires_ms.is_(None) | (keys.c.expires_ms > at_ms)
        )
        query = sa.select(sa.func.count()).where(keys.c.scope == access.Scope.ADMIN.value, valid)
        with self._database.reading() as connection:
            return int(connection.execute(query).scalar_one())


class AuditLog(StorePart):
    """The newest changes; older ones are deleted."""

    def append(self, change: access.Change) -> access.AuditEntry:
        """Record a change with the current time."""
        # The time is the service's: callers' clocks differ, and a log must be in one order.
        values, at_ms = asdict(change), now_ms()
        statement = sa.insert(audit).values(at_ms=at_ms, **values).returning(audit.c.id)
        with self._database.writing() as connection:
            number: int = connection.execute(statement).scalar_one()
            if number % PRUNED_EVERY == 0:
                oldest = number - KEPT_CHANGES
                connection.execute(sa.delete(audit).where(audit.c.id <= oldest))
        return access.AuditEntry(**values, id=number, at_ms=at_ms)

    def page(self, limit: int, before: int | None = None) -> Page[access.AuditEntry]:
        """Return changes, newest first, with ids below `before`."""
        return self._database.read(_CHANGES.page, limit, before)
