"""Migration 0005: analyses whose one replay stood in a column of theirs."""

from sqlalchemy import inspect, text
from store_checks.examples import running

from eigenfail.testing.examples import analysis_result
from eigenfail.values import AnalysisSettings
from eigenfail_services.store import migrate, open_store


def columns(connection) -> set[str]:
    return {column["name"] for column in inspect(connection).get_columns("analyses")}


def fill(url) -> tuple[int, int, int]:
    """Two analyses, of which the second was replayed; the second's id, and its replays."""
    store = open_store(url)
    campaign, first, second = (running(store).id for _ in range(3))
    store.analyses.create(campaign, AnalysisSettings())
    analysis = store.analyses.create(campaign, AnalysisSettings()).id
    store.analyses.finish(analysis, analysis_result())
    for replay in (first, second):
        store.analyses.link_replay(analysis, replay)
    store.close()
    return analysis, first, second


def test_the_latest_replay_survives_the_way_down_and_up(url, look) -> None:
    analysis, _, latest = fill(url)
    migrate.downgrade(url, "0003")
    assert "replay_campaign" in look(url, columns)
    asked = text("SELECT id, replay_campaign FROM analyses ORDER BY id")
    rows = look(url, lambda connection: [tuple(row) for row in connection.execute(asked)])
    assert rows == [(analysis - 1, None), (analysis, latest)]
    migrate.upgrade(url)
    assert "replay_campaign" not in look(url, columns)
    store = open_store(url)
    assert store.analyses.replays(analysis) == (latest,)
    assert store.analyses.replays(analysis - 1) == ()
    assert store.analyses.get(analysis).result is not None
    assert store.analyses.create(latest, AnalysisSettings()).id == analysis + 1
    store.close()
