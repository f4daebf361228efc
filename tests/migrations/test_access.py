"""Migration 0010: keys of the API, and the audit log."""

from sqlalchemy import inspect
from store_checks.access import DIGEST, change
from store_checks.examples import running

from eigenfail.values.access import Scope
from eigenfail_services.store import migrate, open_store

NEW = {"keys", "audit"}


def tables(connection) -> set[str]:
    return set(inspect(connection).get_table_names())


def test_down_and_up_again(url, look) -> None:
    open_store(url).close()
    assert look(url, tables) >= NEW
    migrate.downgrade(url, "0009")
    assert not look(url, tables) & NEW
    migrate.upgrade(url)
    assert look(url, tables) >= NEW


def test_campaigns_outlive_the_keys_that_made_them(url) -> None:
    store = open_store(url)
    campaign = running(store)
    store.keys.create("one", Scope.ADMIN, DIGEST)
    store.audit.append(change("/api/v1/campaigns/1"))
    store.close()
    migrate.downgrade(url, "0009")
    store = open_store(url)
    assert store.campaigns.get(campaign.id) == campaign
    assert not store.keys.exist()
    assert store.audit.page(10).items == ()
    store.close()
