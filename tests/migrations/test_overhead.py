"""Migration 0006: campaigns that ran before anybody measured what their time went into."""

from sqlalchemy import inspect
from store_checks.examples import running

from eigenfail.values import Overhead
from eigenfail_services.store import migrate, open_store

NEW = {"learning_s", "waiting_s", "discarded_s"}


def columns(connection) -> set[str]:
    return {column["name"] for column in inspect(connection).get_columns("campaigns")}


def test_down_and_up_again(url, look) -> None:
    open_store(url).close()
    migrate.downgrade(url, "0005")
    assert not look(url, columns) & NEW
    migrate.upgrade(url)
    assert look(url, columns) >= NEW


def test_what_was_not_measured_from_the_beginning_stays_unknown(url) -> None:
    store = open_store(url)
    old = running(store).id
    store.campaigns.add_active(old, 5.0, Overhead(1.0, 1.0, 1.0))
    store.close()
    migrate.downgrade(url, "0005")
    store = open_store(url)
    store.campaigns.add_active(old, 2.0, Overhead(1.0, 1.0, 1.0))
    found = store.campaigns.get(old)
    assert (found.active_s, found.overhead) == (7.0, None)
    assert store.campaigns.get(running(store).id).overhead == Overhead()
    store.close()
