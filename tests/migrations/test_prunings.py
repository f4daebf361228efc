"""Migration 0015: what was removed."""

import pytest
from sqlalchemy import inspect
from store_checks.retention import THIRDS, ended

from eigenfail.errors import Conflict
from eigenfail_services.store import migrate, open_store


def tables(connection) -> set[str]:
    return set(inspect(connection).get_table_names())


def test_down_and_up_again_where_nothing_was_pruned(url, look) -> None:
    store = open_store(url)
    campaign = ended(store)
    store.close()
    migrate.downgrade(url, "0014")
    assert "prunings" not in look(url, tables)
    store = open_store(url)
    assert store.campaigns.get(campaign.id) == campaign
    assert store.retention.of(campaign.id) == ()
    store.close()


def test_not_down_where_something_was(url) -> None:
    store = open_store(url)
    campaign = ended(store)
    store.retention.prune(campaign.id, THIRDS, "test")
    store.close()
    with pytest.raises(Conflict, match="Restore a backup from before"):
        migrate.downgrade(url, "0014")
    store = open_store(url)
    assert len(store.retention.of(campaign.id)) == 1
    store.close()
