"""Quotas of keys in memory."""

from collections.abc import Sequence

from eigenfail.values import CampaignSpec
from eigenfail.values.quotas import UNLIMITED, Usage
from eigenfail_services.access.quotas import DAY_MS, refuse_beyond
from eigenfail_services.store.clock import now_ms
from eigenfail_services.store.memory.tables import Tables


def admit(tables: Tables, key: int | None, specs: Sequence[CampaignSpec]) -> None:
    """Let the holder of a key make campaigns, or QuotaExceeded; nobody else has quotas."""
    if key is None or key not in tables.records:
        return
    found = tables.records[key].key
    if found.quotas != UNLIMITED:
        refuse_beyond(key, found.name, found.quotas, used_by(tables, key), specs)


def used_by(tables: Tables, key: int) -> Usage:
    """What the campaigns of a key use now."""
    made = [tables.campaigns[number] for number, maker in tables.made_by.items() if maker == key]
    since_ms = now_ms() - DAY_MS
    episodes = (
        each.counts.planned - each.counts.cancelled for each in made if each.created_ms > since_ms
    )
    return Usage(sum(each.ended_ms is None for each in made), sum(episodes))
