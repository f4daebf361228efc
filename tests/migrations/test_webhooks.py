"""Migration 0025: webhooks and what is to be delivered to them; campaigns stay without."""

from sqlalchemy import inspect
from store_checks.examples import running

from eigenfail.values import CampaignState
from eigenfail.values.webhooks import WebhookRequest
from eigenfail_services.store import migrate, open_store

TABLES = {"webhooks", "webhook_deliveries"}


def tables(connection) -> set[str]:
    return set(inspect(connection).get_table_names())


def test_webhooks_come_and_go_and_campaigns_stay(url, look) -> None:
    store = open_store(url)
    webhook = store.webhooks.create(WebhookRequest("https://hooks.example/"), "whsec_AAAA")
    campaign = running(store)
    store.campaigns.move(campaign.id, CampaignState.DONE)
    assert len(store.webhooks.get(webhook.id).deliveries) == 1
    store.close()
    migrate.downgrade(url, "0024")
    assert not TABLES & look(url, tables)
    store = open_store(url)  # brings the schema up again
    assert look(url, tables) >= TABLES
    assert store.campaigns.get(campaign.id).state is CampaignState.DONE
    assert store.webhooks.page(10).items == ()
    store.close()
