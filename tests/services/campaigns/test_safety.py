"""The safety table of a campaign is worked out once for as long as no result comes in."""

from store_checks.examples import deliver, running

from eigenfail.testing.examples import collision
from eigenfail_services.campaigns import summary
from eigenfail_services.store.store import open_store


def test_a_table_is_worked_out_anew_when_results_come_in_alone(monkeypatch) -> None:
    store, made = open_store("memory://"), []
    work_out = summary.campaign_figures.make_safety
    monkeypatch.setattr(
        summary.campaign_figures, "make_safety", lambda *given: made.append(1) or work_out(*given)
    )
    campaign = running(store, episodes=20)
    deliver(store, campaign, collision(0))

    def table(level: float = 0.95):
        return summary.find_safety(store, store.campaigns.get(campaign.id), level)

    assert table() == table()
    assert len(made) == 1
    assert table(0.9) != table()
    assert len(made) == 2
    deliver(store, campaign, collision(1))
    assert table().completed == 2
    assert len(made) == 3
