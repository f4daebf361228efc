"""What a page's later part tells is worked out beside the page, and is the same."""

import pytest

from eigenfail.errors import StoreUnavailable
from eigenfail.testing.store.examples import collision, deliver, result, running
from eigenfail_services.campaigns import ahead
from eigenfail_services.campaigns.crew import workers_of
from eigenfail_services.campaigns.safety import safety_of
from eigenfail_services.campaigns.spending import spending_of
from eigenfail_services.store.memory import MemoryStore


@pytest.fixture
def store():
    """A store of its own."""
    opened = MemoryStore()
    yield opened
    opened.close()


def test_side_by_side_is_what_each_tells_alone(store) -> None:
    campaign = running(store, episodes=20)
    deliver(store, campaign, collision(1), result(2))
    seen = store.campaigns.get(campaign.id)
    found = ahead.measured(store, seen)
    assert found.safety.collisions == safety_of(store, seen).collisions
    assert found.cost == spending_of(store, seen)
    assert found.workers == workers_of(store, seen)


def test_trouble_is_told_by_who_asks_for_the_answer(store, monkeypatch) -> None:
    def broken(*_):
        raise StoreUnavailable("It is gone.", "Start it.")

    campaign = running(store)
    monkeypatch.setattr(store.episodes, "safety", broken)
    begun = ahead.begin(store, campaign)
    ahead.finish(begun)
    assert all(each.done() for each in begun)
    with pytest.raises(StoreUnavailable, match="It is gone"):
        ahead.measured(store, campaign)
