"""A database held against what is promised: what is sound passes, and every damage is named."""

from contextlib import closing
from hashlib import sha256
from pathlib import Path

import pytest
from sqlalchemy import text
from store_checks.examples import deliver, running

from eigenfail import plugins
from eigenfail.errors import SchemaMismatch, StoreUnavailable
from eigenfail.process_state import ProcessState
from eigenfail.testing.examples import collision, make_errored_result, result
from eigenfail.values.analysis import AnalysisSettings
from eigenfail.values.campaign import CampaignState
from eigenfail.values.episode import EpisodeTask, PriorSource, episode_seed
from eigenfail.values.operations import Check, Verification
from eigenfail.values.records import Delivery, JobKind
from eigenfail_services.campaigns.rounds import FORMAT, Checkpoint, write_checkpoint
from eigenfail_services.store.engine import Database, find_backend
from eigenfail_services.store.store import Store, open_store
from eigenfail_services.upkeep.verify import MAX_SHOWN, verify

STATE = write_checkpoint(Checkpoint(FORMAT, 1, 10, 1, 0, False, None, (), b""))
FINE = {"references", "accounts", "ends", "jobs", "parts", "prunings", "checkpoints"}
LEFT_OVER = (
    "INSERT INTO jobs (kind, subject, queued_ms, lease_until_ms, lease_ms, attempts, progress) "
    "VALUES ('{}', {}, 0, 0, 0, 1, 0)"
)


@pytest.fixture
def filled(url: str) -> str:
    """The address of a database with campaigns in several states: 1 is done, 2 runs."""
    with closing(open_store(url)) as store:
        fill(store)
    return url


def fill(store: Store) -> None:
    done, runs = (running(store, episodes=4) for _ in range(2))
    for campaign in (done, runs):
        deliver(store, campaign, result(0), collision(1), make_errored_result(2))
        store.checkpoints.save(campaign.id, STATE)
    assert (job := store.jobs.claim("test", 60.0, JobKind.CAMPAIGN))
    store.campaigns.move(done.id, CampaignState.DONE)
    assert store.jobs.finish(job)
    store.analyses.create(done.id, AnalysisSettings())


def change(url: str, *statements: str) -> None:
    """Do what no program of ours would do."""
    with closing(Database(find_backend(url))) as database, database.writing() as connection:
        if url.startswith("sqlite"):
            connection.exec_driver_sql("PRAGMA defer_foreign_keys = ON")
        for statement in statements:
            connection.execute(text(statement))


def wrong(found: Verification) -> dict[str, Check]:
    return {check.name: check for check in found.checks if check.defects}


def test_what_is_sound_passes(filled) -> None:
    found = verify(filled)
    assert found.defects == 0
    asked = {check.name for check in found.checks}
    assert asked == (FINE | {"file"} if filled.startswith("sqlite") else FINE - {"references"})


def test_a_service_may_use_the_database_meanwhile(filled) -> None:
    with closing(open_store(filled)) as store:
        assert verify(filled).defects == 0
        assert store.campaigns.get(1).state is CampaignState.DONE


@pytest.mark.fault(
    "damaged database file, row or count",
    group="storage",
    outcome="`eigenfail db verify` finds it and says what to do: restore a backup.",
)
@pytest.mark.parametrize(
    ("damage", "check", "where", "told"),
    [
        (
            "UPDATE campaigns SET completed = 1 WHERE id = 2",
            "accounts",
            "campaign 2",
            "1 completed",
        ),
        ("UPDATE campaigns SET failures = 0 WHERE id = 1", "accounts", "campaign 1", "0 failures"),
        (
            "UPDATE campaigns SET cancelled = 1 WHERE id = 2",
            "accounts",
            "campaign 2",
            "1 cancelled",
        ),
        ("UPDATE campaigns SET cancelled = 0 WHERE id = 1", "ends", "campaign 1", "1 of its epi"),
        (LEFT_OVER.format("campaign", 1), "jobs", "job", "campaign 1, which has ended"),
        (LEFT_OVER.format("analysis", 99), "jobs", "job", "analysis 99, which has ended"),
    ],
)
def test_what_the_rows_tell_is_found(filled, damage, check, where, told) -> None:
    change(filled, damage)
    before = wrong(verify(filled))
    assert list(before) == [check]
    (defect,) = before[check].shown
    assert where in defect.where
    assert told in defect.found


@pytest.mark.fault("damaged database file, row or count")
@pytest.mark.parametrize(
    ("damage", "check", "where"),
    [
        ("DELETE FROM trajectories WHERE campaign = 1 AND \"index\" = 2", "parts", "episode 1/2"),
        ("DELETE FROM scenes WHERE campaign = 2", "parts", "episode 2/1"),
        ("UPDATE checkpoints SET sha256 = 'x' WHERE campaign = 2", "checkpoints", "campaign 2"),
        ("UPDATE campaigns SET planned = 2, cancelled = 0, completed = 1, failed = 1 WHERE id = 1",
         "accounts", "campaign 1"),
    ],
)  # fmt: skip
def test_what_only_a_backup_can_tell_is_found(filled, damage, check, where) -> None:
    change(filled, damage)
    found = wrong(verify(filled))
    assert list(found) == [check]
    assert where in found[check].shown[0].where
    assert "eigenfail db restore" in found[check].shown[0].remedy or check == "checkpoints"


@pytest.mark.fault("damaged database file, row or count")
def test_a_checkpoint_that_is_none_is_found_whatever_its_hash_says(filled) -> None:
    digest = sha256(b"no checkpoint").hexdigest()
    state = "'no checkpoint'" if filled.startswith("postgres") else "CAST('no checkpoint' AS BLOB)"
    change(filled, f"UPDATE checkpoints SET state = {state}, sha256 = '{digest}'")
    (check,) = wrong(verify(filled)).values()
    assert (check.name, check.defects) == ("checkpoints", 2)
    assert "cannot be read" in check.shown[0].found


@pytest.mark.fault("damaged database file, row or count")
def test_many_defects_are_counted_and_the_first_are_shown(url) -> None:
    with closing(open_store(url)) as store:
        for _ in range(MAX_SHOWN + 5):
            deliver(store, running(store), result(0))
    change(url, "DELETE FROM trajectories")
    check = wrong(verify(url))["parts"]
    assert (check.defects, len(check.shown)) == (MAX_SHOWN + 5, MAX_SHOWN)


@pytest.mark.fault("damaged database file, row or count")
def test_rows_without_what_they_belong_to_are_found(sqlite_url) -> None:
    with closing(open_store(sqlite_url)) as store:
        deliver(store, running(store), result(0))
    path = sqlite_url.removeprefix("sqlite:///")
    import sqlite3

    with closing(sqlite3.connect(path)) as connection:
        connection.execute("DELETE FROM campaigns")
        connection.commit()
    assert "references" in wrong(verify(sqlite_url))


@pytest.mark.fault("damaged database file, row or count")
def test_a_damaged_file_is_looked_at_no_further_and_not_written_to(sqlite_url) -> None:
    with closing(open_store(sqlite_url)) as store:
        deliver(store, running(store, episodes=500), *map(result, range(500)))
    path = Path(sqlite_url.removeprefix("sqlite:///"))
    content = bytearray(path.read_bytes())
    half = len(content) // 2
    content[half : half + 40_000] = b"\xff" * 40_000
    path.write_bytes(content)
    found = verify(sqlite_url)
    assert [check.name for check in found.checks] == ["file"]
    assert found.defects
    assert "eigenfail db restore" in found.checks[0].shown[0].remedy
    assert path.read_bytes() == bytes(content)


def test_another_schema_is_refused(sqlite_url, tmp_path) -> None:
    with pytest.raises(StoreUnavailable, match=r"There is no .*db upgrade --database sqlite:///"):
        verify(f"sqlite:///{tmp_path / 'none.db'}")
    change(sqlite_url, "UPDATE eigenfail_schema SET version_num = '0001'")
    with pytest.raises(SchemaMismatch, match=r"0001.*db upgrade --database sqlite:///"):
        verify(sqlite_url)


@pytest.mark.fault("damaged database file, row or count")
def test_stored_episodes_are_run_again_and_one_that_differs_is_found(sqlite_url) -> None:
    with closing(open_store(sqlite_url)) as store:
        campaign = running(store, planner="idm", episodes=4)
        engine = plugins.load(plugins.ENGINES, "default")(campaign.spec.setup())
        tasks = [
            EpisodeTask(n, episode_seed(campaign.spec.seed, n), PriorSource()) for n in range(4)
        ]
        deliveries = [Delivery(each, "test") for each in engine.run(tasks)]
        engine.close()
        store.episodes.commit(campaign.id, deliveries)
    assert verify(sqlite_url, 2).defects == 0
    change(sqlite_url, 'UPDATE episodes SET robustness_m = robustness_m + 1 WHERE "index" = 2')
    check = wrong(verify(sqlite_url, 2))["replays"]
    assert [defect.where for defect in check.shown] == ["episode 1/2"]
    assert verify(sqlite_url).defects == 0


def test_functions_that_are_not_listed_here_are_left_out_by_name(sqlite_url, monkeypatch) -> None:
    with closing(open_store(sqlite_url)) as store:
        under_test = {"simulator": "function", "scenario": "function", "planner": "mine:f"}
        campaign = running(store, **under_test, scenario_parameters={"steps": 2}, episodes=4)
        deliver(store, campaign, result(0))
    found = verify(sqlite_url, 1)
    (check,) = (check for check in found.checks if check.name == "replays")
    assert check.defects == 0
    assert f"EIGENFAIL_FUNCTIONS=mine, whose functions they run: campaigns {campaign.id}." in (
        check.promise
    )
    monkeypatch.setenv("EIGENFAIL_FUNCTIONS", "mine")
    (check,) = wrong(verify(sqlite_url, 1)).values()
    assert check.name == "replays"


def stored_campaign(store, episodes: int = 3, **spec):
    """A campaign with episodes as workers run them: after each change in a process of its own."""
    campaign = running(store, simulator="point_mass", episodes=episodes, **spec)
    tasks = [
        EpisodeTask(n, episode_seed(campaign.spec.seed, n), PriorSource()) for n in range(episodes)
    ]
    engine = plugins.load(plugins.ENGINES, "default")
    results = [next(iter(engine(campaign.spec.setup()).run([task]))) for task in tasks]
    store.episodes.commit(campaign.id, [Delivery(each, "test") for each in results])
    return campaign


@pytest.mark.fault(
    "planner that changes the process of a verification",
    group="plug-ins",
    outcome="`db verify --replay` blames its episodes alone, and names it; sound campaigns, and "
    "the process that verifies, are not touched.",
)
def test_replays_of_a_planner_that_changes_its_process_blame_no_sound_episode(sqlite_url) -> None:
    """Each change that is noticed has its test in tests/workers/worker/test_isolation.py."""
    before = ProcessState()
    with closing(open_store(sqlite_url)) as store:
        # At first the planner does nothing, so that there are results of it; then it does.
        quiet = {"planner": "test_changes_state", "planner_settings": {"what": "nothing"}}
        unsound = stored_campaign(store, **quiet)
        stored_campaign(store, planner="idm")
        stored_campaign(store, **quiet)
    assert verify(sqlite_url, 9).defects == 0
    changed = "spec = replace(spec, '\"nothing\"', '\"rounding\"')"
    change(sqlite_url, f"UPDATE campaigns SET {changed} WHERE id = {unsound.id}")
    check = wrong(verify(sqlite_url, 9))["replays"]
    assert [defect.where for defect in check.shown] == [
        f"episode {unsound.id}/{n}" for n in (0, 1, 2)
    ]
    for defect in check.shown:
        assert (
            "planner: The planner 'test_changes_state' changed process-wide state" in defect.found
        )
    assert before.changes() == []


@pytest.mark.fault(
    "planner that ends the process of a verification",
    group="plug-ins",
    outcome="`db verify --replay` reports the episodes that cannot be run, and runs the others.",
)
def test_replays_of_a_planner_that_dies_are_reported_and_the_others_are_run(sqlite_url) -> None:
    with closing(open_store(sqlite_url)) as store:
        dying = stored_campaign(store, episodes=2, planner="idm")
        stored_campaign(store, episodes=2, planner="idm")
    named = "spec = replace(spec, '\"idm\"', '\"test_dies\"')"
    change(sqlite_url, f"UPDATE campaigns SET {named} WHERE id = {dying.id}")
    check = wrong(verify(sqlite_url, 4))["replays"]
    assert [defect.where for defect in check.shown] == [f"episode {dying.id}/{n}" for n in (0, 1)]
    assert "exited with code 7" in check.shown[0].found
    assert "eigenfail episode replay" in check.shown[0].remedy


def test_a_campaign_whose_planner_is_not_here_is_reported_for_each_episode(sqlite_url) -> None:
    with closing(open_store(sqlite_url)) as store:
        lost = stored_campaign(store, episodes=2, planner="idm")
    named = "spec = replace(spec, '\"idm\"', '\"gone\"')"
    change(sqlite_url, f"UPDATE campaigns SET {named} WHERE id = {lost.id}")
    check = wrong(verify(sqlite_url, 2))["replays"]
    assert [defect.where for defect in check.shown] == [f"episode {lost.id}/{n}" for n in (0, 1)]
    assert "'gone' is not known" in check.shown[0].found
