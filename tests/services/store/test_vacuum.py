"""Room that is given back."""

import sqlite3
from contextlib import closing
from pathlib import Path
from typing import NamedTuple

import pytest
from store_checks.examples import deliver, running

from eigenfail.errors import SchemaMismatch, ServiceError, StoreUnavailable
from eigenfail.testing.examples import result
from eigenfail.values.campaign import CampaignState
from eigenfail.values.operations import Retention
from eigenfail_services.store import open_store, schema
from eigenfail_services.upkeep import maintenance as module
from eigenfail_services.upkeep.maintenance import PruneSelection, prune, vacuum
from eigenfail_services.upkeep.verify import verify

COUNT = 1_000


class Usage(NamedTuple):
    """A disk."""

    free: int


def fill(url: str) -> None:
    with closing(open_store(url)) as store:
        campaign = running(store, episodes=COUNT)
        deliver(store, campaign, *(result(n, steps=200) for n in range(COUNT)))
        store.campaigns.move(campaign.id, CampaignState.DONE)
        assert (job := store.jobs.claim("test", 60.0))
        assert store.jobs.finish(job)
    prune(url, Retention(keep_every=1_000), PruneSelection())


def test_what_was_pruned_is_given_back(url) -> None:
    fill(url)
    done = vacuum(url)
    assert done.bytes_after < done.bytes_before
    if url.startswith("sqlite"):
        assert done.bytes_before - done.bytes_after > COUNT * 200 * 2 * 2 * 4 * 0.9
        assert Path(url.removeprefix("sqlite:///")).stat().st_size == done.bytes_after
    assert verify(url).defects == 0
    with closing(open_store(url)) as store:
        assert store.campaigns.get(1).counts.completed == COUNT


def test_a_file_that_somebody_uses_is_left_alone(sqlite_url) -> None:
    with closing(open_store(sqlite_url)) as store:
        store.ping()
        with pytest.raises(ServiceError, match=r"locked.*Stop the service"):
            vacuum(sqlite_url)
        running(store)
    vacuum(sqlite_url)
    with closing(open_store(sqlite_url)) as store:
        assert store.campaigns.get(1)


def test_a_server_is_swept_beside_a_service(prepared_postgres_url) -> None:
    with closing(open_store(prepared_postgres_url)) as store:
        running(store)
        assert vacuum(prepared_postgres_url).bytes_after
        assert store.campaigns.get(1)


def test_no_room_is_said_before_anything_is_begun(sqlite_url, monkeypatch, tmp_path) -> None:
    vacuum(sqlite_url)  # Migrations leave free pages, which the copy does not need.
    size = Path(sqlite_url.removeprefix("sqlite:///")).stat().st_size
    monkeypatch.setattr(module, "disk_usage", lambda _: Usage(2 * size - 1))
    monkeypatch.setenv("SQLITE_TMPDIR", str(tmp_path))
    with pytest.raises(ServiceError, match=rf"needs {2 * size} bytes in {tmp_path}.*Make room"):
        vacuum(sqlite_url)
    monkeypatch.setattr(module, "disk_usage", lambda _: Usage(2 * size))
    vacuum(sqlite_url)


def test_the_copy_is_written_where_sqlite_writes_it(monkeypatch, tmp_path) -> None:
    monkeypatch.setenv("TMPDIR", str(tmp_path))
    monkeypatch.setenv("SQLITE_TMPDIR", str(tmp_path / "none"))
    assert module._find_temporary_folder() == tmp_path
    (tmp_path / "none").mkdir()
    assert module._find_temporary_folder() == tmp_path / "none"


def test_two_disks_need_room_each(tmp_path) -> None:
    shm = Path("/dev/shm")
    if not shm.exists() or shm.stat().st_dev == tmp_path.stat().st_dev:
        pytest.skip("there is one disk")
    assert module._list_needs(shm, 3, tmp_path, 4) == {shm: 3, tmp_path: 4}
    assert module._list_needs(tmp_path, 3, tmp_path, 4) == {tmp_path: 7}


def test_what_is_not_there_or_of_another_schema_is_refused(sqlite_url, tmp_path) -> None:
    with pytest.raises(StoreUnavailable):
        vacuum(f"sqlite:///{tmp_path / 'none.db'}")
    with closing(sqlite3.connect(sqlite_url.removeprefix("sqlite:///"))) as file, file:
        file.execute(f"UPDATE {schema.VERSION_TABLE} SET version_num = '0999'")
    with pytest.raises(SchemaMismatch):
        vacuum(sqlite_url)
