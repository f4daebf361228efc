"""Migration 0017: the versions of the services that ran a campaign, of which older releases kept
none."""

from sqlalchemy import inspect
from store_checks.examples import deliver, running

from eigenfail.testing.examples import result
from eigenfail_services.store import migrate, open_store

OURS, THEIRS = {"eigenfail": "1.0.0"}, {"eigenfail": "1.1.0"}


def columns(connection) -> set[str]:
    return {column["name"] for column in inspect(connection).get_columns("campaigns")}


def test_down_and_up_again(url, look) -> None:
    open_store(url).close()
    migrate.downgrade(url, "0016")
    assert "parts" not in look(url, columns)
    migrate.upgrade(url)
    assert "parts" in look(url, columns)


def test_what_an_older_release_ran_is_told_when_its_campaign_goes_on(url) -> None:
    store = open_store(url)
    campaign = running(store)
    store.campaigns.begin_part(campaign.id, OURS)
    deliver(store, campaign, result(0))
    store.close()
    migrate.downgrade(url, "0016")
    store = open_store(url)  # brings the schema up again
    assert store.campaigns.get(campaign.id).parts == ()
    after = store.campaigns.begin_part(campaign.id, THEIRS)
    told = [event.message for event in store.events.latest(5, campaign.id)]
    kept = store.campaigns.get(campaign.id)
    store.close()
    assert after == kept
    assert after.is_mixed
    assert "after 1 result: the earlier release recorded none; eigenfail 1.1.0 now." in told[0]
