"""Migration 0003: campaigns that were stored before they carried an estimate."""

from sqlalchemy import inspect
from store_checks.examples import running

from eigenfail.values import Estimate
from eigenfail_services.store import migrate, open_store

TOLD = Estimate(by="subset simulation", episodes=7, problem="Not known yet.")


def columns(connection) -> set[str]:
    return {column["name"] for column in inspect(connection).get_columns("campaigns")}


def test_down_and_up_again(url, look) -> None:
    store = open_store(url)
    campaign = running(store).id
    store.checkpoints.save(campaign, b"state", TOLD)
    store.close()
    migrate.downgrade(url, "0002")
    assert "estimate" not in look(url, columns)
    migrate.upgrade(url)
    assert "estimate" in look(url, columns)


def test_a_campaign_without_an_estimate_goes_on_and_gets_one(url) -> None:
    store = open_store(url)
    campaign = running(store).id
    store.checkpoints.save(campaign, b"state", TOLD)
    store.close()
    migrate.downgrade(url, "0002")
    store = open_store(url)
    assert store.campaigns.get(campaign).estimate is None
    assert store.checkpoints.load(campaign) == b"state"
    store.checkpoints.save(campaign, b"later", TOLD)
    assert store.campaigns.get(campaign).estimate == TOLD
    store.close()
