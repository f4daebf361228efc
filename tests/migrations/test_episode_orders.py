"""Migration 0008: indices for the orders of episodes, on a database that has episodes already."""

from sqlalchemy import inspect
from store_checks.examples import deliver, running

from eigenfail.filters import WORST_FIRST
from eigenfail.testing.examples import collision, result
from eigenfail_services.store import migrate, open_store

ORDERS = {"robustness_m", "log_probability", "severity", "min_ttc_s", "max_drac_mps2"}


def orders(connection) -> set[str]:
    indices = inspect(connection).get_indexes("episodes")
    columns = [index["column_names"] for index in indices]
    return {names[1] for names in columns if names[::2] == ["campaign", "index"]}


def test_down_and_up_again(url, look) -> None:
    store = open_store(url)
    campaign = running(store)
    deliver(store, campaign, result(0), collision(1))
    store.close()
    migrate.downgrade(url, "0007")
    assert not look(url, orders) & ORDERS
    store = open_store(url)
    found = store.episodes.page(campaign.id, 10, sort=WORST_FIRST).items
    store.close()
    assert [row.index for row in found] == [1, 0]
    assert look(url, orders) == ORDERS | {"violated"}  # since migration 0019
