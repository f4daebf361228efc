"""Noise that is taken away: what stays true, what is refused, and what a killed pruning leaves."""

import json
import signal
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from contextlib import closing
from types import SimpleNamespace
from typing import Any

import pytest
from accepted import accept_spec
from pruned import COUNT, EVERYTHING, FIFTHS, LOST, change, ended, fill
from sqlalchemy import Engine, event
from store_checks.examples import deliver, running

from eigenfail.errors import Conflict, InvalidValue
from eigenfail.testing.examples import result, spec
from eigenfail.values.campaign import CampaignState
from eigenfail.values.operations import Retention
from eigenfail_services.campaigns.summary import find_safety, summarise_campaign
from eigenfail_services.store import retention
from eigenfail_services.store.campaign_creation import create_campaigns, request_one
from eigenfail_services.store.engine import Database, find_backend
from eigenfail_services.store.retention import SLICE
from eigenfail_services.store.store import Store, open_store
from eigenfail_services.upkeep import pruning
from eigenfail_services.upkeep.pruning import PruneSelection, prune, rehearse
from eigenfail_services.upkeep.verify import verify

PRUNE_AND_TELL = """
import sys
from eigenfail.values.operations import Retention
from eigenfail_services.store import retention
from eigenfail_services.upkeep import pruning
retention.SLICE = 50
recorded = retention._record_slice
def slow(*arguments):
    record = recorded(*arguments)
    print(record.through, flush=True)
    return record
retention._record_slice = slow
pruning.prune(sys.argv[1], Retention(keep_every=5), pruning.PruneSelection())
"""


@pytest.fixture
def filled(url) -> str:
    """The address of a database with two campaigns: 1 is done, 2 runs."""
    with closing(open_store(url)) as store:
        fill(store)
        deliver(store, running(store), result(1))
    return url


def figures(store: Store, campaign: int) -> list[object]:
    """What is told of a campaign."""
    seen, episodes, sums = store.campaigns.get(campaign), store.episodes, store.figures
    return [
        seen,
        summarise_campaign(store, seen),
        find_safety(store, seen, 0.95),
        sums.course(campaign, 5),
        sums.spending(campaign),
        episodes.digest(campaign),
        [row.digest for row in episodes.page(campaign, COUNT).items],
    ]


def test_no_figure_changes_and_nothing_is_missed(filled) -> None:
    with closing(open_store(filled)) as store:
        before = figures(store, 1)
    would = rehearse(filled, FIFTHS, EVERYTHING)
    assert (would.is_rehearsal, would.weight.episodes) == (True, LOST)
    with closing(open_store(filled)) as store:
        assert store.retention.of(1) == ()
    done = prune(filled, FIFTHS, EVERYTHING)
    assert (done.is_rehearsal, done.campaigns) == (False, would.campaigns)
    with closing(open_store(filled)) as store:
        assert json.dumps(str(figures(store, 1))) == json.dumps(str(before))
        assert store.retention.of(1)[0].weight == would.weight
    assert verify(filled).defects == 0
    assert prune(filled, FIFTHS, EVERYTHING).campaigns == ()


def test_noise_that_nobody_pruned_is_still_missed(filled) -> None:
    prune(filled, FIFTHS, EVERYTHING)
    change(filled, 'DELETE FROM trajectories WHERE campaign = 1 AND "index" IN (10, 11)')
    found = {check.name: check for check in verify(filled).checks if check.defects}
    assert [defect.where for defect in found["parts"].shown] == ["episode 1/10", "episode 1/11"]
    assert f"{LOST + 2} episodes are without noise" in found["prunings"].shown[0].found


def test_only_what_is_meant_is_pruned(filled) -> None:
    with pytest.raises(Conflict, match="Campaign 2 is running"):
        prune(filled, FIFTHS, PruneSelection((2,)))
    assert prune(filled, FIFTHS, PruneSelection(older_than_days=1.0)).campaigns == ()
    assert prune(filled, Retention(5, "trajectory"), EVERYTHING).campaigns == ()
    with closing(open_store(filled)) as store:
        fill(store, method="replay", settings={"campaign": 1})
    with pytest.raises(InvalidValue, match="is a proof"):
        prune(filled, FIFTHS, PruneSelection((3,)))
    assert [each.campaign for each in prune(filled, FIFTHS, EVERYTHING).campaigns] == [1]


@pytest.mark.parametrize(
    ("method", "settings"),
    [
        ("difs", {"data_from": [1]}),
        ("replay", {"campaign": 1, "episodes": [2]}),
        ("ensemble", {"method": "difs", "settings": {"data_from": [1]}}),
    ],
)
def test_what_another_campaign_still_needs_is_left_alone(filled, method, settings) -> None:
    with closing(open_store(filled)) as store:
        other = store.campaigns.create(accept_spec(spec(method=method, settings=settings))).id
    found = prune(filled, FIFTHS, EVERYTHING)
    assert (found.campaigns, found.in_use) == ((), (1,))
    with closing(open_store(filled)) as store:
        store.campaigns.move(other, CampaignState.CANCELLED)
    assert prune(filled, FIFTHS, EVERYTHING).weight.episodes == LOST


def test_a_replay_that_is_queued_meanwhile_keeps_what_is_left(filled, monkeypatch) -> None:
    asked: list[int] = []

    def queue_after_the_first_slice(_seconds: float) -> None:
        if not asked:
            with closing(open_store(filled)) as store:
                replay = spec(method="replay", settings={"campaign": 1, "episodes": [COUNT - 1]})
                asked.append(store.campaigns.create(accept_spec(replay)).id)

    monkeypatch.setattr(retention, "SLICE", 3)
    played = SimpleNamespace(monotonic=float, sleep=queue_after_the_first_slice)
    monkeypatch.setattr(pruning, "time", played)
    found = prune(filled, FIFTHS, EVERYTHING)
    assert (found.weight.episodes, found.in_use) == (3, (1,))
    with closing(open_store(filled)) as store:
        assert store.episodes.get(1, COUNT - 1).noise.z.size
        store.campaigns.move(asked[0], CampaignState.CANCELLED)
    assert prune(filled, FIFTHS, EVERYTHING).weight.episodes == LOST - 3
    assert verify(filled).defects == 0


def test_noise_waits_for_a_replay_that_is_just_being_queued(prepared_postgres_url) -> None:
    """Whoever writes a SQLite database is alone there; a PostgreSQL one has many writers."""
    url = prepared_postgres_url
    waits = "SELECT count(*) FROM pg_locks WHERE NOT granted"
    with closing(open_store(url)) as store, closing(Database(find_backend(url))) as database:
        fill(store)
        with ThreadPoolExecutor() as threads:
            with database.writing() as connection:
                replay = spec(method="replay", settings={"campaign": 1, "episodes": [1]})
                create_campaigns(connection, [request_one(accept_spec(replay))], None)
                done = threads.submit(prune, url, FIFTHS, EVERYTHING)
                with database.reading() as watching:
                    while not watching.exec_driver_sql(waits).scalar():
                        assert not done.done()
            found = done.result()
        assert (found.campaigns, found.in_use) == ((), (1,))
        assert store.episodes.get(1, 1).noise.z.size


@pytest.mark.service
def test_one_that_was_killed_goes_on_where_it_was(url) -> None:
    with closing(open_store(url)) as store:
        campaign = running(store, episodes=1_000)
        deliver(store, campaign, *map(result, range(1_000)))
        ended(store, campaign)
    command = [sys.executable, "-c", PRUNE_AND_TELL, url]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as process:
        assert process.stdout is not None
        seen = [int(process.stdout.readline()) for _ in range(4)]
        process.send_signal(signal.SIGKILL)
    assert verify(url).defects == 0
    with closing(open_store(url)) as store:
        (record,) = store.retention.of(campaign.id)
        assert seen[-2] <= record.through < 999
        prune(url, FIFTHS, EVERYTHING)
        assert sum(each.weight.episodes for each in store.retention.of(campaign.id)) == 800
    assert verify(url).defects == 0


def test_a_slice_is_as_large_as_it_says(sqlite_url) -> None:
    with closing(open_store(sqlite_url)) as store:
        campaign = running(store, episodes=2 * SLICE)
        deliver(store, campaign, *(result(n, steps=0) for n in range(2 * SLICE)))
        ended(store, campaign)
        record = store.retention.prune(campaign.id, FIFTHS, "test")
        assert record is not None
        assert record.weight.episodes == SLICE


@pytest.mark.parametrize("ask", ["weigh", "prune"])
def test_no_other_campaign_is_looked_through(sqlite_url, ask) -> None:
    asked: list[tuple[str, tuple[object, ...]]] = []

    def note(*told: Any) -> None:
        asked.append(told[2:4])

    with closing(open_store(sqlite_url)) as store:
        fill(store)
        event.listen(Engine, "before_cursor_execute", note)
        try:
            getattr(store.retention, ask)(1, FIFTHS, *["test"] * (ask == "prune"))
        finally:
            event.remove(Engine, "before_cursor_execute", note)
    assert asked
    with closing(Database(find_backend(sqlite_url))) as database, database.reading() as connection:
        for statement, given in asked:
            if not statement.lstrip().startswith(("BEGIN", "PRAGMA")):
                plan = connection.exec_driver_sql(f"EXPLAIN QUERY PLAN {statement}", given).all()
                assert "SCAN" not in str(plan).replace("SCAN event_counter", ""), plan
