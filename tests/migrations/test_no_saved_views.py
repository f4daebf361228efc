"""Migration 0029: the table of saved views goes, with its rows; campaigns stay."""

from contextlib import closing

from sqlalchemy import inspect, text
from store_checks.modes import crashed

from eigenfail_services.store import migrate, open_store
from eigenfail_services.store.engine import Database, find_backend

SAVED = text(
    "INSERT INTO saved_views (name, page, query, author, saved_ms)"
    " VALUES ('hard', 'episodes', '{}', 'anna', 1)"
)


def tables(connection) -> set[str]:
    return set(inspect(connection).get_table_names())


def test_saved_views_are_dropped_and_campaigns_stay(url, look) -> None:
    store = open_store(url)
    campaign = crashed(store)
    digest = store.episodes.digest(campaign.id)
    store.close()
    migrate.downgrade(url, "0028")
    with closing(Database(find_backend(url))) as database, database.writing() as connection:
        connection.execute(SAVED)
    store = open_store(url)  # brings the schema up again
    assert "saved_views" not in look(url, tables)
    assert store.episodes.digest(campaign.id) == digest
    store.close()
