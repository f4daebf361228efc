"""Migration 0020: the offers of the bridges of workers, of which older releases kept none."""

from sqlalchemy import inspect

from eigenfail.values.operations import Arrival
from eigenfail_services.store import migrate, open_store

LONG_AGO = 0


def columns(connection) -> set[str]:
    return {column["name"] for column in inspect(connection).get_columns("arrivals")}


def test_down_and_up_again_leaves_the_workers_and_no_offer(url, look) -> None:
    store = open_store(url)
    (number,) = store.roster.arrived([Arrival(worker="w", host="h", pid=1)])
    store.roster.set_offers(
        {number: '{"name": "b", "version": "1", "scenarios": [], "planners": []}'}
    )
    assert len(store.roster.list_offers()) == 1
    store.close()
    migrate.downgrade(url, "0019")
    assert "offer" not in look(url, columns)
    migrate.upgrade(url)
    store = open_store(url)
    assert [each.worker for each in store.roster.present(LONG_AGO)] == ["w"]
    assert store.roster.list_offers() == ()
    store.close()
