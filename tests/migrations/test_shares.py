"""Migration 0014: priorities, who made a campaign, and quotas of keys."""

from sqlalchemy import inspect
from store_checks.examples import running
from store_checks.quotas import key_with

from eigenfail.testing.examples import spec
from eigenfail.values import Priority
from eigenfail.values.access import UNLIMITED, Quotas, Usage
from eigenfail_services.store import migrate, open_store

NEW = {
    "campaigns": {"priority", "made_by"},
    "keys": {"max_open", "max_episodes", "max_episodes_per_day"},
}


def columns(connection) -> dict[str, set[str]]:
    found = inspect(connection)
    return {table: {column["name"] for column in found.get_columns(table)} for table in NEW}


def test_down_and_up_again(url, look) -> None:
    open_store(url).close()
    migrate.downgrade(url, "0013")
    assert not any(look(url, columns)[table] & names for table, names in NEW.items())
    migrate.upgrade(url)
    assert all(look(url, columns)[table] >= names for table, names in NEW.items())


def test_what_an_older_release_made_is_of_normal_priority_and_has_no_quotas(url) -> None:
    store = open_store(url)
    key = key_with(store, Quotas(max_open=1))
    campaign = running(store, priority=Priority.HIGH)
    queued = store.campaigns.create(spec(), "again", key)
    store.close()
    migrate.downgrade(url, "0013")
    store = open_store(url)
    assert store.campaigns.get(campaign.id).spec == spec()
    assert store.campaigns.create(spec(), "again", key) == queued
    assert store.keys.find(key).key.quotas == UNLIMITED
    assert store.keys.usage([key]) == {key: Usage()}
    store.close()
