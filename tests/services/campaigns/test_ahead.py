"""What a page's later part tells is worked out beside the page, and is the same."""

import pytest
from store_checks.examples import deliver, running

from eigenfail.errors import StoreUnavailable
from eigenfail.testing.examples import collision, result
from eigenfail_services.campaigns import costs
from eigenfail_services.campaigns.costs import find_spending
from eigenfail_services.campaigns.summary import find_safety, find_worker_shares


def test_side_by_side_is_what_each_tells_alone(store) -> None:
    campaign = running(store, episodes=20)
    deliver(store, campaign, collision(1), result(2))
    seen = store.campaigns.get(campaign.id)
    found = costs.find_figures(store, seen)
    assert found.safety.collisions == find_safety(store, seen).collisions
    assert found.cost == find_spending(store, seen)
    assert found.workers == find_worker_shares(store, seen)


def test_trouble_is_told_by_who_asks_for_the_answer(store, monkeypatch) -> None:
    def broken(*_):
        raise StoreUnavailable("It is gone.", "Start it.")

    campaign = running(store)
    monkeypatch.setattr(store.figures, "safety", broken)
    begun = costs.prefetch_figures(store, campaign)
    costs.wait_for_figures(begun)
    assert all(each.done() for each in begun)
    with pytest.raises(StoreUnavailable, match="It is gone"):
        costs.find_figures(store, campaign)
