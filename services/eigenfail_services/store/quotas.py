"""Quotas of keys in SQL: what is used is counted in the transaction that uses more."""

from collections.abc import Sequence
from typing import Any

from sqlalchemy import Connection, Select, case, func, select

from eigenfail.values import CampaignSpec
from eigenfail.values.quotas import UNLIMITED, Quotas, Usage
from eigenfail_services.access.quotas import DAY_MS, refuse_beyond
from eigenfail_services.store.clock import now_ms
from eigenfail_services.store.schema import campaigns, keys

QUOTAS = Quotas.__struct_fields__
LIMITS = select(keys.c.name, *(keys.c[name] for name in QUOTAS))


def admit(connection: Connection, key: int | None, specs: Sequence[CampaignSpec]) -> None:
    """Let the holder of a key make campaigns; whoever shows none has no quotas.

    Nobody else makes any with the key until the transaction ends.

    Raises:
        QuotaExceeded: it would be more than the key allows.
    """
    if key is None:
        return
    found = connection.execute(LIMITS.where(keys.c.id == key).with_for_update()).first()
    if found is None:
        return
    name, *limits = found
    if (quotas := Quotas(*limits)) != UNLIMITED:
        refuse_beyond(key, name, quotas, used_by(connection, [key])[key], specs)


def used_by(connection: Connection, wanted: Sequence[int]) -> dict[int, Usage]:
    """What the campaigns of each key use now."""
    nothing = dict.fromkeys(wanted, Usage())
    found = connection.execute(usage(wanted, now_ms() - DAY_MS)).all()
    return nothing | {row.made_by: Usage(int(row.open), int(row.episodes)) for row in found}


def usage(wanted: Sequence[int], since_ms: int) -> Select[Any]:
    """Campaigns that are open, and episodes of those that were made since a moment, by key."""
    is_open = campaigns.c.ended_ms.is_(None)
    is_new = campaigns.c.created_ms > since_ms
    episodes = case((is_new, campaigns.c.planned - campaigns.c.cancelled), else_=0)
    return (
        select(
            campaigns.c.made_by,
            func.sum(case((is_open, 1), else_=0)).label("open"),
            func.sum(episodes).label("episodes"),
        )
        .where(campaigns.c.made_by.in_(wanted), is_open | is_new)
        .group_by(campaigns.c.made_by)
    )
