"""Migration 0018: the importance of each step, which older releases did not ask for."""

from sqlalchemy import inspect
from store_checks.examples import deliver, running

from eigenfail.testing.examples import collision
from eigenfail_services.store import migrate, open_store


def columns(connection) -> set[str]:
    return {column["name"] for column in inspect(connection).get_columns("trajectories")}


def test_down_and_up_again(url, look) -> None:
    open_store(url).close()
    migrate.downgrade(url, "0017")
    assert "importance" not in look(url, columns)
    migrate.upgrade(url)
    assert "importance" in look(url, columns)


def test_episodes_of_older_releases_have_none(url) -> None:
    store = open_store(url)
    campaign = running(store)
    deliver(store, campaign, collision(0))
    store.close()
    migrate.downgrade(url, "0017")
    store = open_store(url)  # brings the schema up again
    found = store.episodes.get(campaign.id, 0)
    store.close()
    assert found.importance is None
    assert found.digest() == collision(0).digest()
