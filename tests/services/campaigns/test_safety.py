"""The safety table of a campaign is worked out once for as long as no result comes in."""

from eigenfail.testing.store.examples import collision, deliver, running
from eigenfail_services.campaigns import safety
from eigenfail_services.store.memory import MemoryStore


def test_a_table_is_worked_out_anew_when_results_come_in_alone(monkeypatch) -> None:
    store, made = MemoryStore(), []
    work_out = safety.safety
    monkeypatch.setattr(safety, "safety", lambda *given: made.append(1) or work_out(*given))
    campaign = running(store, episodes=20)
    deliver(store, campaign, collision(0))

    def table(level: float = 0.95):
        return safety.safety_of(store, store.campaigns.get(campaign.id), level)

    assert table() == table()
    assert len(made) == 1
    assert table(0.9) != table()
    assert len(made) == 2
    deliver(store, campaign, collision(1))
    assert table().completed == 2
    assert len(made) == 3
