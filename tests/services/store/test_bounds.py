"""What grows without end is cut."""

from store_checks.examples import running

from eigenfail.errors import clean_text
from eigenfail.testing.examples import make_errored_result
from eigenfail.values.operations import Arrival
from eigenfail.values.records import Delivery
from eigenfail_services.store import events, roster
from eigenfail_services.store.schema import LONGEST_PROSE
from eigenfail_services.store.store import open_store


def test_the_event_log_forgets_its_oldest(store, monkeypatch) -> None:
    monkeypatch.setattr(events, "KEPT_EVENTS", 7)
    monkeypatch.setattr(events, "PRUNED_EVERY", 5)
    for number in range(1, 31):
        assert store.events.append("campaign.progress", str(number)).id == number
    kept = [event.id for event in store.events.after(0, 100)]
    assert kept == list(range(24, 31))
    assert store.events.last() == 30


def test_the_list_of_workers_forgets_its_oldest(store, monkeypatch) -> None:
    monkeypatch.setattr(roster, "KEPT_ARRIVALS", 7)
    monkeypatch.setattr(roster, "PRUNED_EVERY", 5)
    for number in range(1, 31):
        told = Arrival(worker=f"{number:02}", host="", pid=number)
        assert store.roster.arrived([told]) == [number]
    assert [presence.id for presence in store.roster.present(0)] == list(range(24, 31))


def test_long_texts_are_cut(sql_store) -> None:
    campaign = running(sql_store)
    sql_store.episodes.commit(
        campaign.id, [Delivery(make_errored_result(0, "x" * 1_000_000), "w" * 1_000_000)]
    )
    row = sql_store.episodes.page(campaign.id, 1).items[0]
    assert len(row.worker) == LONGEST_PROSE
    assert row.problem == f"planner: {clean_text('x' * 1_000_000)}"
    assert len(row.problem) <= len("planner: ") + LONGEST_PROSE


def test_memory_is_let_go_with_the_store(sqlite_url, tmp_path) -> None:
    for _ in range(3):
        open_store(sqlite_url).close()
    assert [path.name for path in tmp_path.iterdir()] == ["eigenfail.db"]
