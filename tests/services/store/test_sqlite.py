"""What only SQLite has to be told."""

import os
from collections.abc import Iterator
from contextlib import closing
from pathlib import Path

import pytest
from store_checks.examples import deliver, running

from eigenfail.testing.examples import result
from eigenfail_services.store.engine import Database, find_backend
from eigenfail_services.store.store import open_store

DURABLE = {"journal_mode": "wal", "synchronous": 2, "foreign_keys": 1, "busy_timeout": 10_000}


@pytest.mark.parametrize(("pragma", "wanted"), DURABLE.items())
def test_every_connection_is_durable_and_patient(sqlite_url, pragma, wanted) -> None:
    with closing(Database(find_backend(sqlite_url))) as database:
        for block in (database.reading, database.writing):
            with block() as connection:
                assert connection.exec_driver_sql(f"PRAGMA {pragma}").scalar() == wanted


def test_a_reader_sees_one_moment_and_holds_up_no_writer(sqlite_url) -> None:
    store = open_store(sqlite_url)
    campaign = running(store)
    with closing(Database(find_backend(sqlite_url))) as database, database.reading() as connection:
        count = "SELECT count(*) FROM episodes"
        assert connection.exec_driver_sql(count).scalar() == 0
        deliver(store, campaign, result(0))
        assert connection.exec_driver_sql(count).scalar() == 0
    assert store.campaigns.get(campaign.id).counts.completed == 1
    store.close()


def test_an_error_undoes_the_whole_transaction(sqlite_url) -> None:
    def half(database: Database) -> None:
        with database.writing() as connection:
            connection.exec_driver_sql("UPDATE event_counter SET last = 99")
            raise LookupError

    with closing(Database(find_backend(sqlite_url))) as database, pytest.raises(LookupError):
        half(database)
    store = open_store(sqlite_url)
    assert store.events.last() == 0
    store.close()


def test_ids_are_never_given_twice(sqlite_url) -> None:
    store = open_store(sqlite_url)
    running(store)
    job = store.jobs.claim("somebody", 60.0)
    assert store.jobs.finish(job)
    running(store)
    assert store.jobs.claim("somebody", 60.0).id == job.id + 1
    store.close()


@pytest.fixture
def lenient() -> Iterator[None]:
    """Files are made for everybody, unless their maker says otherwise."""
    before = os.umask(0)
    yield
    os.umask(before)


def modes(folder: Path) -> dict[str, str]:
    return {path.name: f"{path.stat().st_mode & 0o777:o}" for path in (folder, *folder.iterdir())}


def test_what_is_stored_is_for_its_owner_alone(tmp_path, lenient) -> None:
    folder = tmp_path / "data"
    with closing(open_store(f"sqlite:///{folder / 'a.db'}")) as store:
        running(store)
        found = modes(folder)
    assert found == {"data": "700", "a.db": "600", "a.db-wal": "600", "a.db-shm": "600"}


def test_whoever_was_let_in_stays(tmp_path, lenient) -> None:
    path = tmp_path / "a.db"
    open_store(f"sqlite:///{path}").close()
    path.chmod(0o640)
    with closing(open_store(f"sqlite:///{path}")) as store:
        running(store)
        assert modes(tmp_path)["a.db-wal"] == modes(tmp_path)["a.db"] == "640"
