"""Migration 0021: the cause of a collision, which older releases did not record."""

from msgspec.structs import replace
from sqlalchemy import inspect
from store_checks.examples import deliver, running

from eigenfail.filters import parse_filter
from eigenfail.testing.examples import CRASH, collision
from eigenfail_services.store import migrate, open_store


def columns(connection) -> set[str]:
    return {column["name"] for column in inspect(connection).get_columns("episodes")}


def test_causes_are_kept_from_then_on(url, look) -> None:
    store = open_store(url)
    campaign = running(store)
    deliver(store, campaign, collision(0))
    store.close()
    migrate.downgrade(url, "0020")
    assert "cause" not in look(url, columns)
    migrate.upgrade(url)
    store = open_store(url)
    told = (replace(CRASH, cause="phantom"), replace(CRASH, cause=f"reveal\x00{'!' * 5000}"))
    deliver(store, campaign, *(collision(1 + k, measures=each) for k, each in enumerate(told)))
    rows = store.episodes.page(campaign.id, 10).items
    where = parse_filter('cause = "phantom"')
    named = store.episodes.page(campaign.id, 10, where=where).items
    read = store.episodes.get(campaign.id, 1).measures
    store.close()
    assert [row.cause for row in rows[:2]] == [None, "phantom"]
    assert (rows[2].cause[:7], len(rows[2].cause)) == ("reveal\ufffd", 4000)
    assert [row.index for row in named] == [1]
    assert read.cause == "phantom"
