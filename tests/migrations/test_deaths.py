"""Migration 0012: how many workers an episode took with it."""

from sqlalchemy import inspect
from store_checks.examples import running

from eigenfail_services.store import migrate, open_store


def tables(connection) -> set[str]:
    return set(inspect(connection).get_table_names())


def test_down_and_up_again_with_a_campaign_that_had_deaths(url, look) -> None:
    store = open_store(url)
    campaign = running(store)
    assert [store.episodes.add_death(campaign.id, 0) for _ in range(2)] == [1, 2]
    store.close()
    migrate.downgrade(url, "0011")
    assert "deaths" not in look(url, tables)
    store = open_store(url)
    assert store.campaigns.get(campaign.id) == campaign
    assert store.episodes.add_death(campaign.id, 0) == 1
    store.close()
