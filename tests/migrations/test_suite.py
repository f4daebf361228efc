"""Migration 0007: campaigns whose suite stood in their names alone."""

from sqlalchemy import inspect, text
from store_checks.examples import running

from eigenfail.values.campaign import CampaignFilter
from eigenfail_services.store import migrate, open_store

INDEX = "ix_campaigns_suite_id"
NAMES = {
    "sweep: alpha=1": "sweep",
    "sweep: alpha=2: again": "sweep",
    "alone": None,
    "sweep: alpha=1: replay of analysis 4, lanes=2": None,
    "Stau ✓: 'one'": "Stau ✓",
    "nul\x00: one": "nul�",
}


def columns(connection) -> set[str]:
    return {column["name"] for column in inspect(connection).get_columns("campaigns")}


def indexes(connection) -> set[str]:
    return {index["name"] for index in inspect(connection).get_indexes("campaigns")}


def suites(connection) -> list[str | None]:
    return list(connection.execute(text("SELECT suite FROM campaigns ORDER BY id")).scalars())


def test_down_and_up_again(url, look) -> None:
    open_store(url).close()
    migrate.downgrade(url, "0006")
    assert "suite" not in look(url, columns)
    assert INDEX not in look(url, indexes)
    migrate.upgrade(url)
    assert "suite" in look(url, columns)
    assert INDEX in look(url, indexes)


def test_campaigns_of_an_older_release_get_the_suite_of_their_name(url, look) -> None:
    store = open_store(url)
    for name in NAMES:
        running(store, name=name)
    store.close()
    as_created = look(url, suites)
    assert as_created == list(NAMES.values())
    migrate.downgrade(url, "0006")
    migrate.upgrade(url)
    assert look(url, suites) == as_created
    store = open_store(url)
    found = store.campaigns.page(10, where=CampaignFilter(suite="sweep")).items
    assert [campaign.spec.name for campaign in found] == [*NAMES][1::-1]
    store.close()
