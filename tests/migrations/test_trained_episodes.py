"""Migration 0004: campaigns that were stored before they carried how long they were trained."""

from sqlalchemy import inspect
from store_checks.examples import running

from eigenfail_services.store import migrate, open_store


def columns(connection) -> set[str]:
    return {column["name"] for column in inspect(connection).get_columns("campaigns")}


def test_a_campaign_of_before_goes_on_and_tells_it(url, look) -> None:
    store = open_store(url)
    campaign = running(store).id
    store.checkpoints.save(campaign, b"state", trained_episodes=170)
    store.close()
    migrate.downgrade(url, "0003")
    assert "trained_episodes" not in look(url, columns)
    store = open_store(url)
    assert store.campaigns.get(campaign).trained_episodes is None
    assert store.checkpoints.load(campaign) == b"state"
    store.checkpoints.save(campaign, b"later", trained_episodes=180)
    assert store.campaigns.get(campaign).trained_episodes == 180
    store.close()
