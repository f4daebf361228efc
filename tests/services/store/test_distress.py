"""Who cannot write says so to everybody on the database, until it can or is gone."""

import json
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import closing
from pathlib import Path

import deadlines
import pytest
from accepted import accept_spec
from small_disks import fill, mount_small_disk
from store_checks.examples import deliver, running

from eigenfail.errors import StoreUnwritable
from eigenfail.testing.examples import result, spec
from eigenfail.values.campaign import Campaign
from eigenfail_services.store import alarms
from eigenfail_services.store.engine import find_backend
from eigenfail_services.store.store import Store, open_store
from eigenfail_services.upkeep.verify import verify

pytestmark = pytest.mark.service

PATIENCE_S = deadlines.PROCESS_S

CUT = "SELECT pg_terminate_backend(pid, 60000) FROM pg_stat_activity WHERE datname = '{}'"
"""Returns when the connections are gone."""

PREAMBLE = """
import json, resource, signal, sys
from eigenfail_services.store.store import Store
from eigenfail.errors import StoreUnwritable
from eigenfail.testing.examples import result
from store_checks.examples import deliver, running
from eigenfail_services.store import alarms
from eigenfail_services.store.store import open_store
alarms.LASTS_S = 600.0
def tell(**words): print(json.dumps(words), flush=True)
def go_on(): sys.stdin.readline()
store = open_store(sys.argv[1])
campaign = running(store, episodes=1_000_000)
"""

OUT_OF_ROOM = (
    PREAMBLE
    + """
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
_, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
resource.setrlimit(resource.RLIMIT_FSIZE, (1_000_000, hard))
try:
    for index in range(0, 1_000_000, 64):
        deliver(store, campaign, *map(result, range(index, index + 64)))
except StoreUnwritable as error:
    tell(problem=str(error))
go_on()
"""
)

UNSYNCED = (
    PREAMBLE
    + """
acked, failed, problem = [], 0, ""
for index in range(200):
    try:
        deliver(store, campaign, result(index))
        acked.append(index)
    except StoreUnwritable as error:
        failed, problem = failed + 1, str(error)
stored = [each.index for each in store.episodes.finished(campaign.id, range(200))]
counts = store.campaigns.get(campaign.id).counts
tell(acked=acked, failed=failed, problem=problem, stored=stored, completed=counts.completed)
"""
)


@pytest.fixture
def start() -> Iterator[Callable[..., "subprocess.Popen[str]"]]:
    """Starts Python on a piece of code, behind other words; ends what is left of it."""
    started = []

    def start(code: str, url: str, *before: str) -> "subprocess.Popen[str]":
        command = [*before, sys.executable, "-c", code, url]
        pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE}
        started.append(subprocess.Popen(command, text=True, **pipes))
        return started[-1]

    yield start
    for process in started:
        process.kill()
        process.communicate()


@pytest.fixture
def small_tablespace(postgres) -> Iterator[Path]:
    """A folder with little room, where the server may put what is in a database."""
    owner = postgres._server.pgdata.stat().st_uid
    # Not below the folders of pytest, which the server's user may not enter.
    folder = Path(tempfile.mkdtemp(prefix="eigenfail-ts-", dir="/tmp"))
    try:
        with mount_small_disk(folder, "32m"):
            space = folder / "space"
            space.mkdir(mode=0o700)
            os.chown(space, owner, owner)
            postgres.run(f"CREATE TABLESPACE small LOCATION '{space}'")
            yield folder
            postgres.run("DROP TABLESPACE small")
    finally:
        folder.rmdir()


@pytest.fixture
def lasting(monkeypatch) -> None:
    """What is said is not over before it is heard, however slow the machine."""
    monkeypatch.setattr(alarms, "LASTS_S", 600.0)


def until_ready(store: Store) -> None:
    deadline_s = time.monotonic() + PATIENCE_S
    while True:
        try:
            return store.ping()
        except StoreUnwritable:
            assert time.monotonic() < deadline_s
            time.sleep(0.02)


@pytest.mark.fault("disk full")
def test_a_full_disk_is_told_to_other_processes_and_forgotten_with_the_one(
    start, sqlite_url
) -> None:
    with closing(open_store(sqlite_url)) as store:
        store.ping()
        process = start(OUT_OF_ROOM, sqlite_url)
        told = json.loads(process.stdout.readline())["problem"]
        assert "cannot be written" in told
        assert "has room" in told
        with pytest.raises(StoreUnwritable, match=r"disk is full.*No work.*has room"):
            store.ping()
        process.kill()
        process.wait()
        store.ping()


@pytest.mark.fault("disk full")
def test_distress_ends_by_itself(sqlite_url, monkeypatch) -> None:
    monkeypatch.setattr(alarms, "LASTS_S", 0.2)
    calling = alarms.WriteAlarm(find_backend(sqlite_url).signal())
    with closing(open_store(sqlite_url)) as store:
        calling.begin()
        calling.begin()
        until_ready(store)


@pytest.mark.fault("disk full")
def test_two_in_distress_are_one_and_looking_is_in_nobodys_way(lasting, sqlite_url) -> None:
    first, second = (alarms.WriteAlarm(find_backend(sqlite_url).signal()) for _ in range(2))
    with closing(open_store(sqlite_url)) as one, closing(open_store(sqlite_url)) as other:
        first.begin()
        second.begin()
        for store in (one, other):
            with pytest.raises(StoreUnwritable):
                store.ping()
        first.end()
        second.end()
        one.ping()
        other.ping()


@pytest.mark.fault("disk of a PostgreSQL server full, or server read-only")
def test_a_server_that_takes_no_writes_is_told_to_all(
    lasting, postgres, prepared_postgres_url
) -> None:
    name = prepared_postgres_url.split("?")[0].rsplit("/", 1)[1]
    with closing(open_store(prepared_postgres_url)) as looker:
        looker.ping()
        postgres.run(f"ALTER DATABASE {name} SET default_transaction_read_only = on")
        with closing(open_store(prepared_postgres_url)) as writer:
            with pytest.raises(StoreUnwritable, match="read-only transaction"):
                writer.campaigns.create(accept_spec(spec()))
            with pytest.raises(StoreUnwritable, match="No work is handed out"):
                looker.ping()
        looker.ping()


@pytest.mark.fault("disk of a PostgreSQL server full, or server read-only")
def test_a_server_that_forgot_it_is_told_again(lasting, postgres, prepared_postgres_url) -> None:
    name = prepared_postgres_url.split("?")[0].rsplit("/", 1)[1]
    calling = alarms.WriteAlarm(find_backend(prepared_postgres_url).signal())
    with closing(open_store(prepared_postgres_url)) as looker:
        calling.begin()
        postgres.run(CUT.format(name))
        looker.ping()
        calling.begin()
        with pytest.raises(StoreUnwritable, match="No work is handed out"):
            looker.ping()
        calling.end()
        looker.ping()


def commit_all(store: Store, campaign: Campaign, acked: list[int]) -> None:
    """Commit one portion of results after the other."""
    while True:
        portion = range(len(acked), len(acked) + 64)
        deliver(store, campaign, *map(result, portion))
        acked += portion


@pytest.mark.fault(
    "disk of a PostgreSQL server full, or server read-only",
    group="storage",
    outcome="The same as a full disk. A server without space for its write-ahead log shuts "
    "itself down and is unavailable until there is space and it is started again.",
)
def test_a_full_disk_of_a_server_loses_nothing_and_is_told_to_all(
    *, lasting, small_tablespace, postgres, prepared_postgres_url
) -> None:
    name = prepared_postgres_url.split("?")[0].rsplit("/", 1)[1]
    postgres.run(f"ALTER DATABASE {name} SET TABLESPACE small")
    filler = small_tablespace / "filler"
    with (
        closing(open_store(prepared_postgres_url)) as writer,
        closing(open_store(prepared_postgres_url)) as looker,
    ):
        campaign = running(writer, episodes=1_000_000)
        fill(filler)
        acked: list[int] = []
        with pytest.raises(StoreUnwritable, match=r"cannot be written: .*No space left.*has room"):
            commit_all(writer, campaign, acked)
        with pytest.raises(StoreUnwritable, match="No work is handed out"):
            looker.ping()
        assert looker.campaigns.get(campaign.id).counts.completed == len(acked)
        filler.unlink()
        assert deliver(writer, campaign, result(len(acked))) == ["kept"]
    assert verify(prepared_postgres_url).defects == 0


@pytest.mark.fault(
    "fsync that fails",
    group="storage",
    outcome="Data that could not be synced are not acknowledged and are written again; "
    "`/readyz` says so. A PostgreSQL server restarts itself.",
)
def test_what_could_not_be_synced_is_not_acknowledged(start, sqlite_url, strace) -> None:
    """An error of the disk at 20 of the calls that bring data to it, then none any more."""
    process = start(UNSYNCED, sqlite_url, *strace("error=EIO:when=60..79"))
    told = json.loads(process.communicate(timeout=PATIENCE_S)[0])
    assert told["failed"] > 0
    assert "disk I/O error" in told["problem"]
    assert set(told["acked"]) <= set(told["stored"])
    assert told["completed"] == len(told["stored"])
    assert max(told["acked"]) == 199
    with closing(open_store(sqlite_url)) as store:
        assert store.campaigns.get(1).counts.completed >= len(told["acked"])
