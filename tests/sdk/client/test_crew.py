"""Who ran the episodes, and what failures cost by method, through the client."""

import pytest
from store_checks.examples import deliver, running

from eigenfail.errors import NotFound
from eigenfail.testing.examples import collision, result


def test_workers_of_a_campaign_and_of_late(client, store):
    one, other = running(store), running(store)
    deliver(store, one, collision(0), result(1))
    deliver(store, other, result(0))
    assert [
        (each.worker, each.episodes, each.failures) for each in client.campaigns.workers(one.id)
    ] == [("worker-1", 2, 1)]
    lately = client.workers(within_s=3_600)
    assert [(each.campaign, each.episodes) for each in lately] == [(one.id, 2), (other.id, 1)]
    with pytest.raises(NotFound):
        client.campaigns.workers(99)


def test_costs_by_method(client, store):
    assert client.campaigns.costs_by_method() == ()
    campaign = running(store, price_usd_per_hour=1.0)
    deliver(store, campaign, collision(0), result(1))
    store.campaigns.add_active(campaign.id, 3_600.0)
    learned = running(store, method="ast")
    deliver(store, learned, result(0))
    (group,) = client.campaigns.costs_by_method()
    first, second = group.methods
    assert (first.method, first.cost.per_failure_usd, first.failure_rate.n) == (
        "monte_carlo",
        1.0,
        2,
    )
    assert (second.method, second.cost.per_failure_usd) == ("ast", None)
