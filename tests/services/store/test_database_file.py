"""The file of a SQLite database: found by its URL, told apart from others, and read for real."""

import os
import shutil
import sqlite3
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import deadlines
import pytest
from accepted import accept_spec
from hypothesis import example, given
from hypothesis import strategies as st
from store_checks.examples import deliver, running

from eigenfail.addresses import sqlite_path, sqlite_url
from eigenfail.errors import InvalidValue, StoreDamaged, StoreUnavailable
from eigenfail.hosting.folder import DataFolder
from eigenfail.testing.examples import result, spec
from eigenfail.values.records import Verdict
from eigenfail_services.store.engine import find_backend
from eigenfail_services.store.store import Store, open_store
from eigenfail_services.upkeep.backup import backup, belongs_to, restore
from eigenfail_services.upkeep.verify import verify

ODD = "?#%&;=+@:'\"\\ ~*[]{}|<>$!,\n\tü漢🚗"
NAMES = (
    st.text(st.one_of(st.sampled_from(ODD), st.characters(codec="utf-8")), min_size=1, max_size=20)
    .filter(lambda name: not set(name) & {"/", "\0"} and name not in {".", ".."})
)  # fmt: skip
RESTORE = "eigenfail db restore"


@pytest.fixture
def path(sqlite_url) -> Path:
    """The file of a database with the schema and nothing else."""
    return sqlite_path(sqlite_url)


@pytest.fixture
def store(sqlite_url) -> Iterator[Store]:
    """The store in it."""
    with closing(open_store(sqlite_url, wait_s=0.5)) as store:
        yield store


def refusals(store: Store, campaign, index: int) -> list[StoreUnavailable]:
    """What health, a reader, a new campaign and a result are refused with."""
    attempts = (
        store.ping,
        store.events.last,
        lambda: store.campaigns.create(accept_spec(spec())),
        lambda: deliver(store, campaign, result(index)),
    )
    found = []
    for attempt in attempts:
        with pytest.raises(StoreUnavailable) as caught:
            attempt()
        found.append(caught.value)
    return found


@pytest.mark.fault(
    "data folder whose name has a meaning in URLs",
    group="storage",
    outcome="The database is created in that folder; two folders never share one, and every "
    "command opens the same file.",
)
@given(NAMES, NAMES)
@example("run?1", "run?2")
@example("run#1", "run")
@example("%41", "A")
@example("%2541", "%41")
@example("-rf", "--data=x")
@example("a b+c", "a+b c")
def test_a_database_lies_in_its_folder_whatever_its_name(one, other) -> None:
    with tempfile.TemporaryDirectory() as home:
        folders = [DataFolder(Path(home) / name) for name in (one, other)]
        for folder in folders:
            find_backend(folder.database).prepare()
            assert folder.database_file.is_file()
            assert sqlite_path(folder.database) == folder.database_file
            assert belongs_to(sqlite_path(folder.database), folder.database_file)
            find_backend(folder.database).require()
        assert folders[0].database_file.samefile(folders[1].database_file) == (one == other)
        there = sum(len(names) for _, _, names in os.walk(home))
        assert there == len({one, other})


def test_upkeep_works_in_a_folder_of_an_odd_name(tmp_path) -> None:
    for name in ("run?1", "run#1 %41"):
        folder = DataFolder(tmp_path / name)
        with closing(open_store(folder.database)) as store:
            campaign = running(store)
            deliver(store, campaign, result(0))
        assert verify(folder.database).defects == 0
        file = tmp_path / f"{name}.backup"
        backup(folder.database, file)
        restore(folder.database, file, force=True)
        with closing(open_store(folder.database)) as store:
            assert store.campaigns.get(campaign.id).counts.completed == 1
    assert sorted(each.name for each in tmp_path.rglob("*.db")) == ["eigenfail.db"] * 2


@pytest.mark.parametrize("url", ["sqlite:///run?1/a.db", "sqlite:///a.db?mode=ro"])
def test_a_url_that_would_lose_its_end_is_refused(url) -> None:
    with pytest.raises(InvalidValue, match="%3F"):
        open_store(url)


def test_a_url_typed_by_hand_is_read_as_it_stands(tmp_path) -> None:
    assert sqlite_path("sqlite:////data/a#b ü.db") == Path("/data/a#b ü.db")
    assert sqlite_path("sqlite+pysqlite:////data/%41.db") == Path("/data/A.db")
    assert sqlite_url(Path("/data/100%?#.db")) == "sqlite:////data/100%25%3F%23.db"


@pytest.mark.fault(
    "database file moved away while the service runs",
    group="storage",
    outcome="Nothing more is accepted or acknowledged, reads and `/readyz` say so, and no new file "
    "is created; once it is moved back, everything goes on.",
)
def test_a_moved_database_takes_nothing_until_it_is_back(store, path, tmp_path) -> None:
    campaign = running(store)
    path.rename(tmp_path / "elsewhere")
    for error in refusals(store, campaign, 0):
        assert "moved, deleted or replaced" in error.problem
        assert "Put it back" in error.remedy
    assert not path.exists()
    (tmp_path / "elsewhere").rename(path)
    store.ping()
    assert deliver(store, campaign, result(0)) == [Verdict.KEPT]


@pytest.mark.fault(
    "database file deleted while the service runs",
    group="storage",
    outcome="Nothing more is accepted or acknowledged; the advice names the restoration of a "
    "backup.",
)
def test_a_deleted_database_is_never_written_to_again(store, path, sqlite_url) -> None:
    campaign = running(store)
    path.unlink()
    assert all(RESTORE in error.remedy for error in refusals(store, campaign, 0))
    with pytest.raises(StoreUnavailable, match="write-ahead log"):
        open_store(sqlite_url)
    assert not path.exists()


@pytest.mark.fault(
    "database file replaced by another one while the service runs",
    group="storage",
    outcome="Nothing more is accepted or acknowledged until the first file is back or the service "
    "is started again.",
)
def test_another_file_at_the_same_path_is_not_taken_for_the_database(store, path, tmp_path) -> None:
    campaign = running(store)
    path.rename(tmp_path / "first")
    shutil.copy(tmp_path / "first", path)
    assert all("deleted or replaced" in each.problem for each in refusals(store, campaign, 0))
    (tmp_path / "first").rename(path)
    assert deliver(store, campaign, result(0)) == [Verdict.KEPT]


@pytest.mark.fault("database file moved away while the service runs")
def test_a_move_in_the_middle_of_a_transaction_undoes_it(store, path, tmp_path) -> None:
    elsewhere = tmp_path / "elsewhere"
    campaign = running(store)

    def move_away() -> None:
        with store.campaigns._database.writing() as connection:
            connection.exec_driver_sql("UPDATE campaigns SET failures = 7")
            path.rename(elsewhere)

    with pytest.raises(StoreUnavailable, match="moved, deleted or replaced"):
        move_away()
    elsewhere.rename(path)
    assert store.campaigns.get(campaign.id).counts.failures == 0


@pytest.mark.fault(
    "write-ahead log removed while the service runs",
    group="storage",
    outcome="Nothing more is accepted or acknowledged; an orderly stop brings what it held into "
    "the database.",
)
@pytest.mark.parametrize("ending", ["-wal", "-shm"])
def test_a_lost_log_costs_nothing_if_the_service_is_stopped_in_order(
    store, path, sqlite_url, ending
) -> None:
    campaign = running(store)
    deliver(store, campaign, result(0))
    path.with_name(path.name + ending).unlink()
    for error in refusals(store, campaign, 1):
        assert f"{path.name}{ending} was moved" in error.problem
        assert "never with kill -9" in error.remedy
    store.close()
    with closing(open_store(sqlite_url)) as again:
        assert again.campaigns.get(campaign.id).counts.completed == 1
    assert verify(sqlite_url).defects == 0


@pytest.mark.fault(
    "database file truncated",
    group="storage",
    outcome="Nothing more is accepted, `/readyz` says so, the service does not start on it, and "
    "the advice names `eigenfail db verify` and backups.",
)
@pytest.mark.parametrize("size", [0, 1, 4096, 50_000])
def test_a_truncated_database_is_refused_with_the_remedy(store, path, sqlite_url, size) -> None:
    campaign = running(store)
    os.truncate(path, size)
    for error in refusals(store, campaign, 0):
        assert isinstance(error, StoreDamaged)
        assert RESTORE in error.remedy
        assert "eigenfail db verify" in error.remedy
    store.close()
    with pytest.raises(StoreDamaged, match=RESTORE):
        open_store(sqlite_url)
    found = verify(sqlite_url)
    assert [check.name for check in found.checks if check.defects] == ["file"]


def test_another_program_may_compact_the_database_of_a_running_service(store, path) -> None:
    campaign = running(store, episodes=200)
    deliver(store, campaign, *(result(index) for index in range(200)))
    with closing(sqlite3.connect(path)) as other:
        other.execute("PRAGMA wal_checkpoint")
        store.ping()  # has seen the file at its longest
        before = path.stat().st_size
        other.execute("DELETE FROM episodes")
        other.commit()
        other.execute("VACUUM")
        other.execute("PRAGMA wal_checkpoint")
    assert path.stat().st_size < before
    store.ping()
    assert store.campaigns.get(campaign.id).state == "running"
    store.campaigns.create(accept_spec(spec()))
    os.truncate(path, path.stat().st_size - 4096)
    for error in refusals(store, campaign, 0):
        assert isinstance(error, StoreDamaged)


@pytest.mark.fault(
    "database file overwritten with other bytes",
    group="storage",
    outcome="`/readyz` says so within a second, the service does not start on it, and the advice "
    "names `eigenfail db verify` and backups.",
)
def test_an_overwritten_database_is_noticed_although_pages_are_remembered(
    store, path, sqlite_url
) -> None:
    deliver(store, running(store), result(0))
    store.ping()
    with path.open("r+b") as file:  # the same file, of the same size
        file.write(os.urandom(path.stat().st_size))
    with pytest.raises(StoreDamaged, match="eigenfail db verify"):
        store.ping()
    store.close()
    with pytest.raises(StoreDamaged, match=RESTORE):
        open_store(sqlite_url)
    assert verify(sqlite_url).defects


@pytest.mark.fault(
    "database file of 0 bytes at the start",
    group="storage",
    outcome="It is refused as lost data, and neither it nor its write-ahead log is touched.",
)
def test_an_empty_file_is_never_a_new_database(tmp_path) -> None:
    path, log = tmp_path / "a.db", tmp_path / "a.db-wal"
    path.touch()
    log.write_bytes(b"what could still be saved")
    for migrate in (True, False):
        with pytest.raises(StoreDamaged, match=rf"has 0 bytes.*{RESTORE}.*new database"):
            open_store(sqlite_url(path), migrate=migrate)
    assert (path.stat().st_size, log.read_bytes()) == (0, b"what could still be saved")


def test_a_restoration_takes_the_place_of_an_empty_file(sqlite_url, tmp_path) -> None:
    backup(sqlite_url, tmp_path / "backup")
    lost = tmp_path / "lost.db"
    lost.touch()
    restore(f"sqlite:///{lost}", tmp_path / "backup")
    open_store(f"sqlite:///{lost}").close()


@pytest.mark.fault(
    "database lock held by another program",
    group="storage",
    outcome="Requests that write are refused with 503 within five seconds, `/readyz` says so, "
    "heartbeats are answered, and everything goes on once the lock is free.",
)
@pytest.mark.parametrize("kind", ["IMMEDIATE", "EXCLUSIVE"])
def test_a_held_lock_is_told_in_bounded_time(store, path, kind) -> None:
    campaign = running(store)
    with closing(sqlite3.connect(path, isolation_level=None)) as other:
        other.execute(f"BEGIN {kind}")
        for attempt in (store.ping, lambda: deliver(store, campaign, result(0))):
            began_s = time.monotonic()
            with pytest.raises(StoreUnavailable, match=r"locked.*holds its lock"):
                attempt()
            assert time.monotonic() - began_s < 5.0
        other.execute("ROLLBACK")
    store.ping()
    assert deliver(store, campaign, result(0)) == [Verdict.KEPT]


def test_a_probe_writes_nothing(store, path) -> None:
    running(store)
    files = [path, path.with_name(f"{path.name}-wal")]
    before = [file.read_bytes() for file in files]
    for _ in range(3):
        store.ping()
    assert [file.read_bytes() for file in files] == before


WITHOUT_RIGHTS = """
import os, sys
from eigenfail.errors import StoreUnavailable
from eigenfail_services.store.store import open_store

url, file = sys.argv[1:]
store = open_store(url)
store.ping()
if os.getuid() == 0:  # for whom there are no barriers
    folder = os.path.dirname(file)
    for name in (folder, *(os.path.join(folder, name) for name in os.listdir(folder))):
        os.chown(name, 65534, 65534)
    os.setgid(65534)
    os.setuid(65534)
os.chmod(file, 0)
try:
    store.ping()
except StoreUnavailable as error:
    print(error, flush=True)
os.chmod(file, 0o600)
store.ping()
os._exit(7)
"""


@pytest.mark.fault(
    "database file that may no longer be read",
    group="storage",
    outcome="`/readyz` says so and names the permissions; once they are back, everything goes on.",
)
def test_a_file_without_permissions_is_noticed_by_health() -> None:
    with tempfile.TemporaryDirectory() as home:  # where another user comes as far as the folder
        folder = Path(home) / "data"
        folder.mkdir()
        Path(home).chmod(0o755)
        file = folder / "a.db"
        done = subprocess.run(
            [sys.executable, "-c", WITHOUT_RIGHTS, f"sqlite:///{file}", str(file)],
            capture_output=True,
            text=True,
            check=False,
            timeout=deadlines.PROCESS_S,
        )
    assert done.returncode == 7, done.stderr
    assert "may no longer be read and written" in done.stdout
    assert "may read and write" in done.stdout
